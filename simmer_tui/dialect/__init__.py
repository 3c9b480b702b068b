"""A team's own language, as the dialect.toml of its set has it: rules, and the device that follows them."""
