//! The section `[single_sign_on]` of the settings file.

use std::net::IpAddr;
use std::path::PathBuf;

use serde::Deserialize;
use url::{Host, Url};

use crate::domain::role::Role;
use crate::domain::single_sign_on::GroupRoles;

/// Single sign-on with an OpenID Connect provider. Without [`Self::issuer`] there is none.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SingleSignOnSettings {
    /// Address of the provider, exactly as its tokens state it (`iss`), such as `https://id.example/realms/hospital`.
    /// Below it lies `/.well-known/openid-configuration`.
    pub issuer: Option<String>,
    /// The id that the provider has given this service.
    pub client_id: Option<String>,
    /// The file with the secret that the provider has given this service. Without it, the provider must know the
    /// service as a public client.
    pub client_secret_file: Option<PathBuf>,
    /// What to ask the provider for; `openid` is always added. Some providers state the groups only for a further
    /// scope.
    pub scopes: Vec<String>,
    /// The claim that lists the groups of a person; dots lead into objects, as in `realm_access.roles`.
    pub groups_claim: String,
    /// The role of each group: `"group at the provider" = "instructor"`. People of no listed group may not sign in with
    /// the provider.
    pub roles: GroupRoles,
    /// The provider's name on the button of the sign-in page, such as the name of the hospital.
    pub name: Option<String>,
    /// Whether a person of a listed group gets an account at the first sign-in. Without, only people who have linked
    /// their account sign in with the provider.
    pub make_accounts: bool,
}

impl Default for SingleSignOnSettings {
    fn default() -> Self {
        Self {
            issuer: None,
            client_id: None,
            client_secret_file: None,
            scopes: ["openid", "profile", "email"].map(str::to_owned).to_vec(),
            groups_claim: "groups".to_owned(),
            roles: GroupRoles::default(),
            name: None,
            make_accounts: true,
        }
    }
}

/// Longest address of a provider, bytes.
const MAX_ISSUER_BYTES: usize = 1000;

/// A setting that cannot be used: its key, its value, and what is expected.
pub type WrongSetting = (&'static str, String, &'static str);

impl SingleSignOnSettings {
    /// Checks that the settings fit together.
    ///
    /// # Errors
    /// The first setting that does not.
    pub fn check(&self) -> Result<(), WrongSetting> {
        let missing = || "not set".to_owned();
        let Some(issuer) = &self.issuer else {
            let other = self.client_id.is_some() || self.client_secret_file.is_some() || !self.roles.is_empty();
            let expected = "the address of the provider, since other keys of [single_sign_on] are set";
            return if other { Err(("single_sign_on.issuer", missing(), expected)) } else { Ok(()) };
        };
        let is_plain = |url: Url| is_allowed(&url) && url.query().is_none() && url.fragment().is_none();
        if issuer.len() > MAX_ISSUER_BYTES || !issuer.parse().is_ok_and(is_plain) {
            let expected = "an address that begins with https://, without ? and #; http:// only on this machine";
            return Err(("single_sign_on.issuer", format!("`{issuer}`"), expected));
        }
        if self.client_id.as_ref().is_none_or(|id| id.trim().is_empty()) {
            return Err(("single_sign_on.client_id", missing(), "the id that the provider has given this service"));
        }
        if self.groups_claim.is_empty() {
            return Err(("single_sign_on.groups_claim", "empty".to_owned(), "the name of a claim, such as groups"));
        }
        if self.roles.is_empty() {
            let expected = "at least one group with its role, such as { \"trocar-teachers\" = \"instructor\" }";
            return Err(("single_sign_on.roles", "empty".to_owned(), expected));
        }
        if let Some((group, _)) = self.roles.iter().find(|(_, role)| *role == Role::Agent) {
            let value = format!("agent for the group `{group}`");
            return Err(("single_sign_on.roles", value, "administrator, instructor or trainee"));
        }
        let is_short = |name: &String| (1..=60).contains(&name.trim().chars().count());
        if self.name.as_ref().is_some_and(|name| !is_short(name)) {
            return Err(("single_sign_on.name", "not usable".to_owned(), "1 to 60 characters"));
        }
        Ok(())
    }
}

/// Whether the service speaks to this address: over HTTPS, or with a program on its own machine.
pub fn is_allowed(url: &Url) -> bool {
    match url.scheme() {
        "https" => url.host().is_some(),
        "http" => url.host().is_some_and(|host| is_loopback(&host)),
        _ => false,
    }
}

fn is_loopback(host: &Host<&str>) -> bool {
    match host {
        Host::Domain(name) => name.eq_ignore_ascii_case("localhost"),
        Host::Ipv4(address) => IpAddr::from(*address).is_loopback(),
        Host::Ipv6(address) => IpAddr::from(*address).to_canonical().is_loopback(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_https_and_the_own_machine_are_allowed() {
        for (address, wanted) in [
            ("https://id.example/realms/a", true),
            ("http://127.0.0.1:8080", true),
            ("http://[::1]:8080", true),
            ("http://localhost", true),
            ("http://id.example", false),
            ("http://localhost.example", false),
            ("http://127.0.0.1.example", false),
            ("ftp://localhost", false),
            ("file:///etc/passwd", false),
        ] {
            assert_eq!(is_allowed(&address.parse().unwrap()), wanted, "{address}");
        }
    }

    #[test]
    fn settings_that_do_not_fit_together_are_refused_by_name() {
        let whole: SingleSignOnSettings = toml::from_str(
            "issuer = \"https://id.example\"\nclient_id = \"trocar\"\n[roles]\nteachers = \"instructor\"\n",
        )
        .unwrap();
        assert_eq!(whole.check(), Ok(()));
        assert_eq!(SingleSignOnSettings::default().check(), Ok(()), "there is no single sign-on");
        let key = |changed: SingleSignOnSettings| changed.check().unwrap_err().0;
        let some = |text: &str| Some(text.to_owned());
        assert_eq!(key(SingleSignOnSettings { issuer: None, ..whole.clone() }), "single_sign_on.issuer");
        assert_eq!(
            key(SingleSignOnSettings { issuer: some("http://id.example"), ..whole.clone() }),
            "single_sign_on.issuer"
        );
        assert_eq!(key(SingleSignOnSettings { client_id: some(" "), ..whole.clone() }), "single_sign_on.client_id");
        assert_eq!(key(SingleSignOnSettings { roles: GroupRoles::default(), ..whole.clone() }), "single_sign_on.roles");
        let agent = GroupRoles::from_iter([("boxes".to_owned(), Role::Agent)]);
        assert_eq!(key(SingleSignOnSettings { roles: agent, ..whole }), "single_sign_on.roles");
        assert!(toml::from_str::<SingleSignOnSettings>("issuers = 1").is_err());
        assert!(toml::from_str::<SingleSignOnSettings>("[roles]\na = \"boss\"").is_err());
    }
}
