//! Tests of the store, each on its own database.

mod audit;
mod box_versions;
mod cohorts;
mod courses;
mod edits;
mod flow;
mod full_disk;
mod isolation;
mod owners;
mod pending_erasures;
mod queue;
mod ratings;
mod record_merges;
mod rescorings;
mod schema;
mod self_tests;
mod sign_in;
mod skill_models;
mod standards;
mod statements;
mod versions;
mod writes;
