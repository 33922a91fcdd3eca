"""Many independent fits, of laboratories or campaigns: `ff.ensemble`, `fmu-fit ensemble`."""

#: Where finished items are kept, in the folder of the results.
ITEMS_FILE = "items.jsonl"
FILES = ("ensemble.json", "ensemble.csv", "ensemble.md", "report.html", "figures/1_ensemble.*")
