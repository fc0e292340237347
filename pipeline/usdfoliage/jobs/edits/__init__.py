"""Jobs on leaves: scatter a spray, edit an asset by a look, bake the edits."""
