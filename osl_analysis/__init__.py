"""From the raw logs of a powered prosthesis to its stiffness, damping and inertia.

Data flows one way: raw log (`ingest`) -> trial -> fit (`fits`, `walking`) -> table -> figure (`figures`).
"""
