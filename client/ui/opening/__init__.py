"""Opening another volume from the page: what lies in folders, and the way from one volume to the next."""
