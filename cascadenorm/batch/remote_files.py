"""List, download and upload files at URLs such as s3://bucket/scan.ply, using fsspec."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

from cascadenorm.errors import CascadenormError, MissingDependencyError, OutputError, ReadError

STORES = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss")
"""Object stores, where an object becomes visible only after it was uploaded completely."""

WEB = ("http", "https")

BROUGHT = ("fsspec", "s3fs", "aiobotocore", "aiohttp", "requests")  # packages that the extra `cluster` installs

RESPONSE_TIMEOUT_S = 60.0  # seconds a web server may stay silent; the total duration of a download is not limited

WILDCARD = re.compile(r"[*\[]")
"""Characters that make a URL a pattern; a question mark is not among them because it starts a query."""


class RemoteFile(NamedTuple):
    """A file at a URL."""

    url: str
    size: int  # in bytes; 0 if the server does not report it
    version: str | None  # changes with the content; None if the file does not exist


class ChangedError(ReadError):
    """Raised if a file was modified while it was read."""


def without_query(url: str) -> str:
    """Return a URL without its query and fragment; only web URLs have these, elsewhere ? and # are part of a name."""
    return re.split("[?#]", url, maxsplit=1)[0] if urlsplit(url).scheme.lower() in WEB else url


def file_name(url: str) -> str:
    """Return the name of a file, without its folder and query."""
    return without_query(url).partition("://")[2].partition("/")[2].rpartition("/")[2]


def fixed_part(url: str) -> str:
    """Return the folder that contains the files of a URL: up to the first wildcard, or the parent of a single file."""
    found = WILDCARD.search(url)
    if found:
        return url[: found.start()].rpartition("/")[0]
    place = without_query(url)
    return place.rpartition("/")[0] if "." in file_name(url) else place.rstrip("/")


def files_at(url: str) -> list[RemoteFile]:
    """List the files of a URL, which may name a file, a folder or a pattern.

    A URL without wildcards whose last part has an extension names a file, whether it exists or not. Raises ReadError if
    the server does not answer or denies access, and MissingDependencyError without fsspec or a package that it needs.
    """
    with _reached(url, ReadError, "read") as (system, path):
        if not WILDCARD.search(url) and "." in file_name(url):
            try:
                return [_described(url, system.info(path))]
            except FileNotFoundError:  # reading it reports the error
                return [RemoteFile(url, 0, None)]
        entries = system.glob(path, detail=True) if WILDCARD.search(url) else system.find(path, detail=True)
        files = {name: entry for name, entry in entries.items() if entry.get("type") != "directory"}
        found = [_described(system.unstrip_protocol(name), entry) for name, entry in files.items()]
    return sorted(file for file in found if "/." not in file.url.removeprefix(fixed_part(url)))


def exists(url: str) -> bool:
    """Test whether a file exists; raises ReadError if the server does not tell."""
    with _reached(url, ReadError, "read") as (system, path):
        return bool(system.exists(path))


def fetched(url: str, folder: Path) -> Path:
    """Download a file and return its path. Raises ReadError, or ChangedError if it was replaced meanwhile."""
    target = folder / file_name(url)
    folder.mkdir(parents=True, exist_ok=True)
    with _reached(url, ReadError, "read") as (system, path):
        before = _version(system, path)
        system.get_file(path, str(target))
        if _version(system, path) != before:
            raise ChangedError(f"{url} changed while it was read", hint="try again when it is complete")
    return target


def _version(system: Any, path: str) -> str:
    """Return a text that changes with the content of a file; empty if the server does not provide one."""
    system.invalidate_cache()
    try:
        return _described(path, system.info(path)).version or ""
    except Exception:  # the download itself reports the error
        return ""


def upload(file: Path, url: str) -> None:
    """Upload a file. Raises OutputError."""
    check_writable(url)
    with _reached(url, OutputError, "written") as (system, path):
        system.put_file(str(file), path)


def check_writable(url: str) -> None:
    """Raise OutputError if files cannot be written to a URL atomically."""
    if file_name(url).lower().endswith(".gltf"):
        raise OutputError(f"{url} would have its buffers in other files, which go to folders only", hint="use .glb")
    if urlsplit(url).scheme.lower() not in STORES:
        raise OutputError(
            f"{url} cannot be written: results go to folders or object stores", hint="use s3://, gs:// or az://"
        )


def _described(url: str, entry: dict[str, Any]) -> RemoteFile:
    kept = ("ETag", "etag", "LastModified", "updated", "md5Hash", "mtime", "size")
    return RemoteFile(url, int(entry.get("size") or 0), "|".join(str(entry[key]) for key in kept if key in entry))


def _opened(url: str) -> tuple[Any, str]:
    """Return the file system of a URL and the path within it, with an empty listing cache."""
    try:
        from fsspec.core import url_to_fs

        system, path = url_to_fs(url, **_options(url))
    except ImportError as error:
        package = error.name or getattr(error.__cause__, "name", None) or "fsspec"
        extra = "cluster" if package in BROUGHT else ""
        raise MissingDependencyError(f"{urlsplit(url).scheme}://", package=package, extra=extra) from None
    system.invalidate_cache()
    return system, path


def _options(url: str) -> dict[str, Any]:
    """Return the options of the file system of a URL; the default of aiohttp limits every download to five minutes."""
    if urlsplit(url).scheme.lower() not in WEB:
        return {}
    import aiohttp

    timeout = aiohttp.ClientTimeout(total=None, sock_connect=RESPONSE_TIMEOUT_S, sock_read=RESPONSE_TIMEOUT_S)
    return {"client_kwargs": {"timeout": timeout}}


@contextmanager
def _reached(url: str, kind: type[ReadError] | type[OutputError], what: str) -> Iterator[tuple[Any, str]]:
    """Provide the file system of a URL and the path within it; like disk errors, their errors count as temporary."""
    try:
        yield _opened(url)
    except CascadenormError:
        raise
    except Exception as error:  # each kind of URL has its own errors
        cause = error if isinstance(error, OSError) else OSError(str(error))
        text = getattr(error, "strerror", None) or str(error) or type(error).__name__
        if isinstance(error, FileNotFoundError) and text in url:  # some kinds only repeat the name
            text = "it does not exist"
        raise kind(f"{url} cannot be {what}: {text}") from cause
