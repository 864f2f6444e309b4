"""What measurements are printed, plotted and recorded as."""
