"""What a logged run amounts to: figures, pictures, and where it went wrong."""
