"""Maps, models and reflections: CCP4/MRC, PDB, mmCIF, MTZ and cube files."""
