"""Report: tables, plots and one page from results tables; only the few drawn trials are run again."""
