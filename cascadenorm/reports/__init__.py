"""Reports: meshes before and after in a browser, with all that is known about them, in one file."""

from cascadenorm.reports.writing import check_report, report, report_denoised

__all__ = ["check_report", "report", "report_denoised"]
