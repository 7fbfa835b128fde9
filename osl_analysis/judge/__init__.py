"""The table of judgements on recordings and fits: table.yaml has its words, `table` its row and the configured limits;
`recording` measures checks, `doubts` judges columns of result tables; `findings` tells jobs which trials they use, and
readers which causes concern which trials."""
