//! Claims about files and database together.
