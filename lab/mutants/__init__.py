"""Mutation testing: does a test notice when a line of the code that decides is changed?"""
