//! One binary for everything that spans parts; `tests/README.md` says which test goes where.

mod api;
mod architecture;
mod child;
mod dependencies;
mod support;
