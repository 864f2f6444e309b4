"""The doctor: looks at each hop to a cluster's servers, and says what is wrong and the cure."""
