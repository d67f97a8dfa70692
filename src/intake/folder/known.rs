//! Finds a trainee, task or box by id, code or name.

/// A trainee, a task or a box.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KnownThing {
    /// Its id.
    pub id: String,
    /// Its short unique name.
    pub code: String,
    /// What people call it.
    pub name: String,
}

/// The one with this id, code or name. Names are compared without regard to case.
///
/// # Errors
/// There is none, or several have this name.
pub fn find<'k>(list: &'k [KnownThing], noun: &str, text: &str) -> Result<&'k KnownThing, String> {
    if let Some(found) = list.iter().find(|one| one.id == text || one.code == text) {
        return Ok(found);
    }
    let wanted = text.to_lowercase();
    let named: Vec<&KnownThing> = list.iter().filter(|one| one.name.to_lowercase() == wanted).collect();
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
        let one =
            |code: &str, name: &str| KnownThing { id: format!("id of {code}"), code: code.into(), name: name.into() };
        let list = [one("ada", "Bob"), one("bob", "Ada Novak"), one("ada-2", "Ada Novak"), one("carl", "Carl Öz")];
        assert_eq!(find(&list, "trainee", "bob").unwrap().code, "bob");
        assert_eq!(find(&list, "trainee", "id of ada").unwrap().code, "ada");
        assert_eq!(find(&list, "trainee", "carl öz").unwrap().code, "carl");
        assert!(find(&list, "trainee", "Ada Novak").unwrap_err().ends_with("bob, ada-2"));
        assert!(find(&list, "trainee", "Dora").unwrap_err().contains("no trainee"));
    }
}
