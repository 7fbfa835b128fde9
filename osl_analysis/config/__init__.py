"""Configuration of a campaign: YAML files, sample sheet, parameters, experiments."""
