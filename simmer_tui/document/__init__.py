"""The document model: typed tables, prose and figures, and their four renderers."""
