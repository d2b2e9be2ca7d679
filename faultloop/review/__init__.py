"""Reading a run: what happened, as tables, text, picture and page."""
