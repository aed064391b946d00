"""The report: one page that holds everything a run or a sweep found out."""
