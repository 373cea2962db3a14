//! Readers of scene files, one file or folder per format.
