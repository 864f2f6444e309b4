"""Scans: DICOM, NIfTI, NRRD, MetaImage, Analyze and TIFF."""
