"""A team's own language, from the dialect.toml of its set: the rules, and the device that follows them."""
