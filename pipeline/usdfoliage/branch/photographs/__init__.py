"""Stems, twigs and petioles that depth loses, traced as lines in photographs."""
