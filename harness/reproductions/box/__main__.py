"""``python -m harness.reproductions.box --out results/reproduce-box``: the box of what the dissertation leaves open."""
