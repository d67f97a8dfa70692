//! Claims about the store, each on a database of its own.

mod flow;
