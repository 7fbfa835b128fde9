"""From the recordings of a powered prosthesis to its stiffness, damping and inertia.

Data flow one way: recording (`formats`, `ingest`) -> trial -> fit (`bench`, `walking`) -> table -> figure (`figures`).
"""
