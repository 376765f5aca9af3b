"""Studies of the robustness of estimators: design, runs, store, results."""
