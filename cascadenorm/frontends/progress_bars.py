"""Progress as a bar of tqdm: a widget in a notebook, a line in a terminal."""

from collections.abc import Iterator
from contextlib import contextmanager

from cascadenorm.errors import MissingDependencyError
from cascadenorm.execution.progress import Listener


@contextmanager
def progress_bar(text: str = "Denoising") -> Iterator[Listener]:
    """Show a progress bar and return a listener for the `progress` argument of other functions.

        with cn.progress_bar() as progress:
            smooth = cn.denoise(mesh, progress=progress)

    Parameters
    ----------
    text
        Label before the bar.

    Yields
    ------
    A function of the completed fraction, from 0 to 1.

    Raises
    ------
    MissingDependencyError
        Tqdm is not installed.
    """
    try:
        from tqdm.auto import tqdm
    except ImportError:
        raise MissingDependencyError("a progress bar", package="tqdm", extra="notebook") from None
    with tqdm(total=1.0, desc=text, bar_format="{l_bar}{bar}[{elapsed}<{remaining}]") as bar:
        yield lambda fraction: bar.update(fraction - bar.n)
