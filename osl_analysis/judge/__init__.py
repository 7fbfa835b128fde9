"""Evidence to findings: `causes` and `judging` decide by values, `words` has the sentences,
`campaign` makes views."""
