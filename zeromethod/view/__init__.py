"""What a person sees: the live status line, the summary table, the figure."""
