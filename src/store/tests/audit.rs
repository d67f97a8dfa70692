//! The audit trail shows present names and the clients' addresses, and no names and addresses of erased people.

use std::net::IpAddr;

use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::standard::{ChartDesign, StandardDefinition};
use crate::domain::text::Key;
use crate::store::PageRequest;
use crate::store::testing::TestCentre;

/// Addresses of two clients.
const ADDRESSES: [&str; 2] = ["203.0.113.7", "2001:db8::7"];

/// The kind and name of what each entry changed, newest first.
async fn trail(centre: &TestCentre) -> Vec<(String, Option<String>)> {
    let page = centre.store.audit().list(&Scope::service(), &PageRequest::default()).await.unwrap();
    page.items.into_iter().map(|entry| (entry.noun, entry.called)).collect()
}

#[tokio::test]
async fn changes_are_listed_under_present_names() {
    let centre = TestCentre::new().await;
    let ada = centre.trainee("Ada").await;
    let ina = centre.person("ina", Role::Instructor, None).await;
    centre.group("Mondays", &[&ina], &[&ada]).await;
    centre.session(ada.id, "a clip").await;
    let standard = StandardDefinition { targets: Vec::new(), rule: None, charts: ChartDesign::default() };
    centre.store.standards().add(&ina.scope(), centre.task.id, standard, None).await.unwrap();
    let trail = trail(&centre).await;
    for (noun, called) in [
        ("session", "Ada"),
        ("group", "Mondays"),
        ("person", "ina"),
        ("trainee", "Ada"),
        ("task", "Peg transfer"),
        ("standard", "Peg transfer"),
        ("box", "Box 1"),
    ] {
        let of: Vec<_> = trail.iter().filter(|(of, _)| of == noun).map(|(_, called)| called.as_deref()).collect();
        assert!(!of.is_empty() && of.iter().all(|of| *of == Some(called)), "{noun}: {of:?}");
    }
}

#[tokio::test]
async fn an_erased_person_has_no_name_in_the_trail() {
    let centre = TestCentre::new().await;
    let ada = centre.trainee("Ada").await;
    centre.session(ada.id, "a clip").await;
    centre.store.trainees().erase(&Scope::service(), &Key::from(&ada.id)).await.unwrap();
    let trail = trail(&centre).await;
    assert!(trail.iter().any(|(noun, _)| noun == "session"));
    assert!(trail.iter().all(|(_, called)| called.as_deref() != Some("Ada")), "{trail:?}");
}

/// The scope for a request of the client with this address.
fn from(scope: Scope, address: &str) -> Scope {
    scope.at_address(address.parse::<IpAddr>().unwrap())
}

/// The address and the kind of each change, newest first.
async fn addresses(centre: &TestCentre) -> Vec<(Option<String>, String, String)> {
    let page = centre.store.audit().list(&Scope::service(), &PageRequest::default()).await.unwrap();
    page.items.into_iter().map(|entry| (entry.address, entry.action, entry.noun)).collect()
}

#[tokio::test]
async fn erasing_a_person_erases_the_addresses_that_they_had_and_no_others() {
    let centre = TestCentre::new().await;
    let (ada, boss) = (centre.trainee("Ada").await, centre.person("boss", Role::Administrator, None).await);
    let own = from(centre.person("ada", Role::Trainee, Some(ada.id)).await.scope(), ADDRESSES[0]);
    let boss = from(boss.scope(), ADDRESSES[1]);
    centre.store.sessions().create(&own, centre.new_session(ada.id, "a clip")).await.unwrap();
    centre.store.audit().record_export(&boss, "trainee", ada.id).await.unwrap();
    let before = addresses(&centre).await;
    assert_eq!(before[0], (Some(ADDRESSES[1].to_owned()), "export".to_owned(), "trainee".to_owned()));
    assert_eq!(before[1], (Some(ADDRESSES[0].to_owned()), "create".to_owned(), "session".to_owned()));
    assert!(before[2..].iter().all(|(address, ..)| address.is_none()), "the service made the rest: {before:?}");
    let about: Vec<_> = centre.store.audit().about(&own, ada.id).await.unwrap();
    let about: Vec<_> = about.iter().filter_map(|entry| entry.address.as_deref()).collect();
    assert_eq!(about, [ADDRESSES[0]], "an export about Ada has no address of other people");

    centre.store.trainees().erase(&boss, &Key::from(&ada.id)).await.unwrap();
    let after = addresses(&centre).await;
    assert!(!after.iter().any(|(address, ..)| address.as_deref() == Some(ADDRESSES[0])), "{after:?}");
    let left = after.iter().filter(|(address, ..)| address.as_deref() == Some(ADDRESSES[1])).count();
    assert_eq!(left, 2, "the administrator's changes keep their address: {after:?}");
    centre.store.audit().record_export(&own, "trainee", ada.id).await.unwrap();
    assert_eq!(addresses(&centre).await[0].0, None, "a request that waited meanwhile leaves none either");
}

#[tokio::test]
async fn an_account_that_deletes_itself_leaves_no_address() {
    let centre = TestCentre::new().await;
    centre.person("boss", Role::Administrator, None).await;
    let eve = centre.person("eve", Role::Administrator, None).await;
    centre.store.people().delete(&from(eve.scope(), ADDRESSES[0]), eve.id).await.unwrap();
    let entries = addresses(&centre).await;
    assert_eq!(entries[0], (None, "delete".to_owned(), "person".to_owned()));
    assert!(entries.iter().all(|(address, ..)| address.is_none()), "{entries:?}");
}
