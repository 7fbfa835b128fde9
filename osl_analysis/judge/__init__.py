"""Evidence to findings: `causes` and `judging` decide by values, `words` has the only sentences, `campaign` makes views."""
