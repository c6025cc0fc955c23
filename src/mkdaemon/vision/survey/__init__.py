"""Where the tags of a room are, by images of them: first places, bundle adjustment, what is wrong with a tag."""
