"""The functions of `import osl_analysis as osl`, for notebooks and scripts that need no workflow.

They call what the jobs of a campaign call: their numbers are those of its tables. `osl_analysis/__init__.py` names
them.
"""
