//! The trainees, tasks and boxes that the service knows, found by id, code or name.

use serde_json::Value;

use super::client::{RequestError, ServiceClient};

/// A trainee, a task or a box.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Known {
    pub id: String,
    pub code: String,
    pub name: String,
}

/// The lists of the service.
#[derive(Debug, Default)]
pub struct Directory {
    pub trainees: Vec<Known>,
    pub tasks: Vec<Known>,
    pub boxes: Vec<Known>,
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

fn known(items: Vec<Value>) -> Vec<Known> {
    let text = |item: &Value, key: &str| item[key].as_str().unwrap_or_default().to_owned();
    items
        .iter()
        .map(|item| Known { id: text(item, "id"), code: text(item, "code"), name: text(item, "name") })
        .collect()
}

/// The one with this id, code or name. Names are compared without regard to case.
///
/// # Errors
/// There is none, or several have this name.
pub fn find<'k>(list: &'k [Known], noun: &str, text: &str) -> Result<&'k Known, String> {
    if let Some(found) = list.iter().find(|one| one.id == text || one.code == text) {
        return Ok(found);
    }
    let wanted = text.to_lowercase();
    let named: Vec<&Known> = list.iter().filter(|one| one.name.to_lowercase() == wanted).collect();
    match named[..] {
        [found] => Ok(found),
        [] => Err(format!("`{text}` is the code or name of no {noun} that you may see on the service")),
        _ => {
            let codes: Vec<&str> = named.iter().map(|one| one.code.as_str()).collect();
            Err(format!("several have the name `{text}`; give the code: {}", codes.join(", ")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_code_comes_before_a_name_and_a_name_must_be_clear() {
        let one = |code: &str, name: &str| Known { id: format!("id of {code}"), code: code.into(), name: name.into() };
        let list = [one("ada", "Bob"), one("bob", "Ada Novak"), one("ada-2", "Ada Novak"), one("carl", "Carl Öz")];
        assert_eq!(find(&list, "trainee", "bob").unwrap().code, "bob");
        assert_eq!(find(&list, "trainee", "id of ada").unwrap().code, "ada");
        assert_eq!(find(&list, "trainee", "carl öz").unwrap().code, "carl");
        assert!(find(&list, "trainee", "Ada Novak").unwrap_err().ends_with("bob, ada-2"));
        assert!(find(&list, "trainee", "Dora").unwrap_err().contains("no trainee"));
    }
}
