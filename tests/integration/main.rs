//! One binary for everything that spans parts; `tests/README.md` says which test goes where.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test that cannot go on has failed")]

mod admin;
mod api;
mod architecture;
mod backups;
mod bare_tools;
mod box_agent;
mod child;
mod commands;
mod dependencies;
mod faults;
mod feed;
mod first_password;
mod golden;
mod inbox;
mod language;
mod memory;
mod old_data;
mod palette;
mod planted;
mod presentation;
mod process;
mod quality;
mod readme;
mod resources;
mod same_colour;
mod schema;
mod skill;
mod stills;
mod support;
mod surroundings;
mod truth;
mod updates;
mod upload_command;
