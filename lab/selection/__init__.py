"""Which effects are missing: score test, candidates, validation on unseen data, forward selection and pruning."""
