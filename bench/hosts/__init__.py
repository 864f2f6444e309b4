"""Several hosts on one machine, as network namespaces with links of a given rate."""
