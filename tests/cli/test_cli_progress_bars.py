"""Progress goes to a terminal alone, except the lines of a log."""

from cascadenorm.cli.progress_bars import progress_bar, progress_tasks


def test_without_a_terminal_only_finished_tasks_of_a_log_are_printed(capsys):
    with progress_bar("denoising") as show, progress_tasks() as silent, progress_tasks(log=True) as logged:
        show(0.5)
        for progress in (silent, logged):
            progress("training", 1, 2)
            progress("training", 2, 2, "loss 0.1")
    assert capsys.readouterr() == ("", "training  loss 0.1: done\n")
