"""The rules that keep chapters in step, and the commands that change several of them: carry, new, fork."""
