//! Claims about the vault, each in a folder of its own.
