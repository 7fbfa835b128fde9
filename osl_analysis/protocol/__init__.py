"""The stepped sine: what was commanded, and what the joint really did."""
