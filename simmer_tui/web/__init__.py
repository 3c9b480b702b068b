"""A live run in browsers: one page, which receives the run's news."""
