"""A live run in browsers: one page, which receives the run's news.

In: the same snapshots and events as the screen's, and requests of viewers.
Out: the page, its frames, and orders of those who may drive.
"""
