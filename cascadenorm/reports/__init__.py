"""Reports: one HTML file with meshes before and after in a 3-D viewer, and everything known about them."""

from cascadenorm.reports.given import checked_truth
from cascadenorm.reports.writing import check_report, report, report_denoised

__all__ = ["check_report", "checked_truth", "report", "report_denoised"]
