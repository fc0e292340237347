"""The branch surface: one closed Catmull-Clark cage of tubes that join at forks."""
