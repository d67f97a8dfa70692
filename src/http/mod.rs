//! HTTP: the interface under `/api/v1`, the pages, and what the people who run the service look at.
//!
//! | file | holds |
//! |---|---|
//! | [`router`] | every route, in one list |
//! | [`error`] | the one table from what went wrong to status and problem document |
//! | [`auth`] | who asks: the one place that makes a [`Scope`](crate::domain::scope::Scope) |
//! | [`read`] [`show`] | bodies, queries and ids in; JSON, pages and times out |
//! | a noun each | what a client can do with it, each function one route |
//! | [`export`] | tables of features, of any length |
//! | [`server`] [`pace`] [`settings`] | connections and bodies that can neither be silent nor too many nor too long |
//! | [`places`] | how many may watch at a time |
//! | [`protect`] [`compress`] [`observe`] | headers, fewer bytes, a log line and numbers for every answer |
//! | [`dashboard`] [`docs`] [`openapi`] | the pages, and the interface's description |
//!
//! A handler names in its arguments who may ask ([`auth::signed_in`]) and hands their scope on: the store finds only
//! what the scope reaches, so what one may not see is not found, with the same bytes as what is not there.

pub mod attention;
pub mod auth;
pub mod boxes;
pub mod cohorts;
pub mod compress;
pub mod courses;
pub mod dashboard;
pub mod docs;
pub mod error;
pub mod events;
pub mod export;
pub mod features;
mod feed;
pub mod file;
pub mod groups;
pub mod health;
mod home;
pub mod jobs;
pub mod observe;
pub mod openapi;
pub mod pace;
pub mod people;
pub mod places;
pub mod protect;
mod push;
pub mod range;
pub mod read;
pub mod rescorings;
pub mod router;
pub mod server;
pub mod service;
pub mod sessions;
pub mod settings;
pub mod show;
mod stall;
pub mod state;
pub mod tasks;
pub mod tokens;
pub mod trainees;
pub mod uploads;
