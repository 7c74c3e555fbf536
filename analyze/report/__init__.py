"""What the user sees: report, plots, exports."""
