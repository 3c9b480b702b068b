"""A run live in browsers: one page, fed as the run goes."""
