//! HTTP: the API under `/api/v1`, the dashboard, health checks and metrics.
//!
//! | file | holds |
//! |---|---|
//! | [`router`] [`replaced_routes`] | every route, in one list; the old names of routes that were replaced |
//! | [`error`] | every error as a status and a problem document |
//! | [`auth`] | authentication: turns a cookie or a token into a [`Scope`](crate::domain::scope::Scope) |
//! | [`single_sign_on`] | signing in with a provider, and the links between accounts here and there |
//! | [`base_path`] | the path that the service lies under, behind a proxy |
//! | [`client_address`] | the client's address, behind proxies too |
//! | [`read`] [`show`] | parts of requests (bodies, queries, ids); parts of answers (JSON, pages, times) |
//! | one module for each noun | its routes, one function each |
//! | `record_merges` | what merges of two records of one person or box look like |
//! | [`export`] [`data_export`] | tables of features, of any length; all data of a person or of the centre as a ZIP file |
//! | [`server`] [`pace`] [`settings`] | limits on connections and bodies: their number, idle time and size |
//! | [`listeners`] [`connection`] [`http2_streams`] | the sockets; one connection: handshake, HTTP/2 or HTTP/1.1, limits on time |
//! | [`tls`] [`certificate_end`] | the service's certificate, and warnings before its end |
//! | [`scheme`] [`redirect`] | HTTPS of the service or of a proxy; plain HTTP to HTTPS |
//! | [`connection_places`] | limits the open connections; closes an idle one for a new one when all places are taken |
//! | [`connection_slots`] | limits on connections that stay open, in all and per user |
//! | [`protect`] [`compress`] [`observe`] | security headers, compression; a log line and metrics for every request |
//! | [`dashboard`] [`docs`] [`openapi`] | the dashboard's files, and the API's description |
//!
//! A handler names by its arguments the roles it accepts ([`auth::signed_in`]) and passes the caller's scope on. The
//! store finds only what the scope covers, so a resource outside the scope is answered like one that does not exist,
//! with the same bytes.

pub mod account;
pub mod attention;
pub mod auth;
pub mod base_path;
pub mod base_url;
pub mod boxes;
pub mod centre;
mod certificate_end;
pub mod certificates;
pub mod client_address;
pub mod cohorts;
pub mod compress;
pub mod connection;
pub mod connection_places;
pub mod connection_slots;
pub mod consent_texts;
pub mod courses;
pub mod dashboard;
pub mod data_export;
pub mod docs;
pub mod error;
pub mod events;
pub mod exams;
pub mod export;
pub mod features;
mod feed;
mod feedback;
pub mod file;
mod first_steps;
pub mod groups;
pub mod health;
pub mod heavy;
mod http2_streams;
pub mod jobs;
pub mod listeners;
pub mod observe;
pub mod openapi;
pub mod pace;
pub mod password_links;
pub mod people;
pub mod protect;
mod push;
pub mod range;
pub mod read;
mod record_merges;
pub mod redirect;
mod replaced_routes;
pub mod rescorings;
pub mod router;
pub mod scheme;
pub mod server;
pub mod service;
pub mod sessions;
pub mod settings;
pub mod show;
pub mod single_sign_on;
mod stall;
pub mod state;
pub mod tasks;
pub mod tls;
pub mod tokens;
pub mod trainees;
pub mod uploads;
pub mod waiting_recordings;
