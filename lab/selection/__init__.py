"""The search for missing effects: forward selection by predictions of unseen samples, and backward elimination."""
