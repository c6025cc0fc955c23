"""The safety stories, a few of each; `mkdaemon bench stories` tells them all."""
