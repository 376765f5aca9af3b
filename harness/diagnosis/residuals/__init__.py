"""What the innovations still hold after the effects with a name: where, when, and along what."""
