//! What an account at a provider of single sign-on means here: its groups, its role, and the names of a new account.
//!
//! The claims come from a verified token, but a person may have chosen some of them, such as the name. So no claim
//! finds an account: only issuer and subject do.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::{Map, Value};

use super::role::Role;
use super::text::{Login, Name, plain_character};

/// Longest login that is derived from claims, characters: leaves room for a number if it is taken.
const MAX_DERIVED_LOGIN: usize = 56;
/// Longest name that is derived from claims, characters.
const MAX_DERIVED_NAME: usize = 120;

/// The claims of a verified token.
pub type Claims = Map<String, Value>;

/// The role that each group of the provider gives. Groups that are not listed give none.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(transparent)]
pub struct GroupRoles(BTreeMap<String, Role>);

impl GroupRoles {
    /// The groups and their roles.
    pub fn iter(&self) -> impl Iterator<Item = (&str, Role)> {
        self.0.iter().map(|(group, role)| (group.as_str(), *role))
    }

    /// Whether no group gives a role.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The role of an account in these groups: of several, the one with the most rights. `None` if no group gives one.
    pub fn role_of(&self, groups: &[String]) -> Option<Role> {
        let roles: Vec<Role> = groups.iter().filter_map(|group| self.0.get(group).copied()).collect();
        [Role::Administrator, Role::Instructor, Role::Trainee].into_iter().find(|role| roles.contains(role))
    }
}

impl FromIterator<(String, Role)> for GroupRoles {
    fn from_iter<I: IntoIterator<Item = (String, Role)>>(pairs: I) -> Self {
        Self(pairs.into_iter().collect())
    }
}

/// An account at a provider that has just proved who it is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ProvenIdentity {
    /// Address of the provider, as its tokens state it.
    pub issuer: String,
    /// The account's id at the provider.
    pub subject: String,
    /// The account's name at the provider, for people.
    pub label: Name,
    /// The name of a new account here.
    pub name: Name,
    /// The login of a new account here, before a number is added if it is taken.
    pub login: Login,
    /// The role that the groups give; `None` if they give none.
    pub role: Option<Role>,
}

impl ProvenIdentity {
    /// Reads the claims of the account `subject`. `claim` names the claim that lists the groups.
    pub fn from_claims(issuer: String, subject: String, claims: &Claims, (claim, roles): (&str, &GroupRoles)) -> Self {
        let text = |name: &str| claims.get(name).and_then(Value::as_str);
        let first = |names: &[&str]| names.iter().find_map(|name| derived_name(text(name)?));
        let fallback = || Name::from_stored("–".to_owned());
        let label = first(&["preferred_username", "email", "name"]);
        let label = label.or_else(|| derived_name(&subject)).unwrap_or_else(fallback);
        let whole = match (text("given_name"), text("family_name")) {
            (Some(given), Some(family)) => derived_name(&format!("{given} {family}")),
            _ => None,
        };
        let name = first(&["name"]).or(whole).unwrap_or_else(|| label.clone());
        let logins = ["preferred_username", "email", "name"].into_iter().filter_map(text);
        let login = logins.filter_map(derived_login).next();
        let login = login.unwrap_or_else(|| Login::from_stored("person".to_owned()));
        let role = roles.role_of(&groups_in(claims, claim).unwrap_or_default());
        Self { issuer, subject, label, name, login, role }
    }
}

/// The groups that a claim lists: texts in a list, or one text. `claim` is the claim's name, or a path through objects
/// such as `realm_access.roles`. `None` if there is no such claim.
pub fn groups_in(claims: &Claims, claim: &str) -> Option<Vec<String>> {
    // The whole name first: names of claims may be addresses, which have dots.
    let found = claims.get(claim).or_else(|| {
        let (first, rest) = claim.split_once('.')?;
        rest.split('.').try_fold(claims.get(first)?, |value, key| value.get(key))
    })?;
    match found {
        Value::String(one) => Some(vec![one.clone()]),
        Value::Array(many) => Some(many.iter().filter_map(|group| group.as_str().map(str::to_owned)).collect()),
        _ => None,
    }
}

/// The login with a number, for when it is taken.
pub fn numbered_login(login: &Login, number: u32) -> Login {
    Login::from_stored(format!("{login}-{number}"))
}

/// A name without what a name may not contain; `None` if nothing visible is left.
fn derived_name(text: &str) -> Option<Name> {
    let visible: String = text.chars().filter(|c| !c.is_control()).take(MAX_DERIVED_NAME).collect();
    visible.parse().ok()
}

/// A login of the characters that a login may have; `None` without a letter or digit.
fn derived_login(text: &str) -> Option<Login> {
    let allowed = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-' | '@' | '+');
    let characters = text.trim().chars().filter_map(|c| if allowed(c) { Some(c) } else { plain_character(c) });
    let login: String = characters.take(MAX_DERIVED_LOGIN).collect();
    login.chars().any(|c| c.is_ascii_alphanumeric()).then(|| login.parse().ok())?
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde_json::json;

    use super::*;

    fn roles() -> GroupRoles {
        let of = |group: &str, role| (group.to_owned(), role);
        GroupRoles::from_iter([
            of("admins", Role::Administrator),
            of("teachers", Role::Instructor),
            of("students", Role::Trainee),
        ])
    }

    fn read(claims: Value) -> ProvenIdentity {
        let Value::Object(claims) = claims else { panic!("no object") };
        ProvenIdentity::from_claims("https://id".to_owned(), "42".to_owned(), &claims, ("groups", &roles()))
    }

    #[test]
    fn groups_give_the_role_with_the_most_rights() {
        for (groups, wanted) in [
            (json!(["students", "teachers", "other"]), Some(Role::Instructor)),
            (json!(["teachers", "admins"]), Some(Role::Administrator)),
            (json!("students"), Some(Role::Trainee)),
            (json!(["other", 7, null]), None),
            (json!(["Admins", "admins ", "adm"]), None),
            (json!({"admins": true}), None),
            (json!([]), None),
            (json!(true), None),
        ] {
            assert_eq!(read(json!({"groups": groups})).role, wanted, "{groups}");
        }
        assert_eq!(read(json!({})).role, None);
    }

    #[test]
    fn a_claim_is_found_by_its_name_or_by_a_path() {
        let claims = json!({"https://a.example/groups": ["a"], "realm_access": {"roles": ["b"]}, "x": ["c"]});
        let found = |claim: &str| groups_in(claims.as_object().unwrap(), claim);
        assert_eq!(found("https://a.example/groups"), Some(vec!["a".to_owned()]));
        assert_eq!(found("realm_access.roles"), Some(vec!["b".to_owned()]));
        for missing in ["realm_access", "realm_access.groups", "x.0", "y", "", "."] {
            assert_eq!(found(missing), None, "{missing}");
        }
    }

    #[test]
    fn a_new_account_is_called_as_at_the_provider() {
        let ada = read(json!({"name": "Ada Lovelace", "preferred_username": "ADA", "email": "ada@a.example"}));
        assert_eq!((ada.name.as_str(), ada.login.as_str(), ada.label.as_str()), ("Ada Lovelace", "ada", "ADA"));
        let ada = read(json!({"given_name": "Ada", "family_name": "Lovelace", "email": "ada@a.example"}));
        assert_eq!((ada.name.as_str(), ada.login.as_str()), ("Ada Lovelace", "ada@a.example"));
        let bare = read(json!({"preferred_username": "\u{202e}", "name": "\n"}));
        assert_eq!((bare.name.as_str(), bare.login.as_str(), bare.label.as_str()), ("42", "person", "42"));
        assert_eq!(read(json!({"name": "Ärzte Müller"})).login.as_str(), "arzte-muller");
    }

    proptest! {
        /// More groups never take rights away, and unknown groups give none.
        #[test]
        fn more_groups_never_mean_fewer_rights(known in proptest::sample::subsequence(
            vec!["admins", "teachers", "students"], 0..=3), other in proptest::collection::vec("[a-z]{1,4}", 0..5)) {
            let rank = |role: Option<Role>| match role {
                None => 0,
                Some(Role::Trainee) => 1,
                Some(Role::Instructor) => 2,
                Some(_) => 3,
            };
            let mut groups: Vec<String> = other;
            let mut before = rank(roles().role_of(&groups));
            prop_assert_eq!(before, 0);
            for group in known {
                groups.push(group.to_owned());
                let now = rank(roles().role_of(&groups));
                prop_assert!(now >= before);
                before = now;
            }
        }

        /// Any claims give names that the rules of input accept, so that people can edit the account later.
        #[test]
        fn any_claims_give_valid_names(name in ".{0,200}", login in ".{0,200}") {
            let read = read(json!({"name": name, "preferred_username": login}));
            prop_assert!(read.name.as_str().parse::<Name>().is_ok());
            prop_assert!(read.label.as_str().parse::<Name>().is_ok());
            prop_assert!(read.login.as_str().parse::<Login>().is_ok());
            prop_assert!(numbered_login(&read.login, 9999).as_str().parse::<Login>().is_ok());
        }
    }
}
