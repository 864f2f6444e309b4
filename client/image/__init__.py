"""Images in files, their lettering and sheets of them."""
