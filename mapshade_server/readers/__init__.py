"""Volume readers behind one small interface."""
