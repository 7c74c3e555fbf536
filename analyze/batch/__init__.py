"""A whole archive: what lies there (archive.py), what a recording gives (analysis.py), who works (run.py), what came of it (summary.py)."""
