"""Report: one page about what is in results tables; it reads them, and runs again only the few trials that it draws."""
