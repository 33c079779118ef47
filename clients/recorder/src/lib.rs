//! Recorder client: every published step into an MCAP file.
