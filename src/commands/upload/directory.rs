//! The trainees, tasks and boxes that the service knows.

use serde_json::Value;

use super::client::{RequestError, ServiceClient};
use crate::intake::folder::KnownThing;

/// The lists of the service.
#[derive(Debug, Default)]
pub struct Directory {
    pub trainees: Vec<KnownThing>,
    pub tasks: Vec<KnownThing>,
    pub boxes: Vec<KnownThing>,
}

impl Directory {
    /// Reads the lists.
    ///
    /// # Errors
    /// The service cannot be reached, or refuses: only staff may list trainees.
    pub async fn read(service: &ServiceClient) -> Result<Self, RequestError> {
        Ok(Self {
            trainees: known(service.read_all("/trainees").await?),
            tasks: known(service.read_all("/tasks").await?),
            boxes: known(service.read_all("/boxes").await?),
        })
    }
}

fn known(items: Vec<Value>) -> Vec<KnownThing> {
    let text = |item: &Value, key: &str| item[key].as_str().unwrap_or_default().to_owned();
    items
        .iter()
        .map(|item| KnownThing { id: text(item, "id"), code: text(item, "code"), name: text(item, "name") })
        .collect()
}
