//! One binary for everything that spans parts; `tests/README.md` says which test goes where.

mod architecture;
mod child;
mod dependencies;
