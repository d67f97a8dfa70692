//! The sessions with live views.
//!
//! Every live view checks often whether its person may still see the session, and whether the recording has ended. All
//! views of a session share its readings: hundreds of browsers cause about one a second.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;

use tokio::time::Instant;

use crate::domain::scope::Scope;
use crate::domain::session::SessionStatus;
use crate::ids::SessionId;
use crate::store::{SessionRecord, SharedSession, Store};

/// The sessions with live views.
#[derive(Debug, Default)]
pub struct WatchedSessions(Mutex<HashMap<SessionId, Weak<WatchedSession>>>);

impl WatchedSessions {
    /// The session, shared by all its views.
    pub fn watch(&self, id: SessionId) -> Arc<WatchedSession> {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner); // no panic leaves the table half changed
        all.retain(|_, session| session.strong_count() > 0);
        if let Some(session) = all.get(&id).and_then(Weak::upgrade) {
            return session;
        }
        let session = Arc::new(WatchedSession { id, latest: tokio::sync::Mutex::default() });
        all.insert(id, Arc::downgrade(&session));
        session
    }
}

/// A session with at least one live view.
#[derive(Debug)]
pub struct WatchedSession {
    /// Its id.
    pub id: SessionId,
    /// When the latest reading began, and what it found; `None` inside if the session could not be read. Views share
    /// this too, so that they do not repeat a failing query one after another.
    latest: tokio::sync::Mutex<Option<(Instant, Option<SharedSession>)>>,
}

impl WatchedSession {
    /// The session's status, from a reading that is at most `max_age` older than this call; `None` if that reading
    /// failed or found no session, or if this scope does not see the session.
    pub async fn status_for(&self, store: &Store, scope: &Scope, max_age: Duration) -> Option<SessionStatus> {
        let asked = Instant::now();
        let mut latest = self.latest.lock().await;
        if latest.as_ref().is_none_or(|(begun, _)| asked.saturating_duration_since(*begun) > max_age) {
            let begun = Instant::now();
            *latest = Some((begun, store.sessions().shared(self.id).await.ok()));
        }
        latest.as_ref()?.1.as_ref()?.seen_by(scope).map(SessionRecord::status)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::role::Role;
    use crate::domain::text::Key;
    use crate::ids::PersonId;
    use crate::store::Members;
    use crate::store::testing::TestCentre;

    const HOUR: Duration = Duration::from_secs(3600);

    #[tokio::test]
    async fn all_views_of_a_session_share_a_reading() {
        let centre = TestCentre::with_camera_and_colours().await;
        let (store, ana) = (&centre.store, centre.trainee("Ana").await);
        let id = centre.session(ana.id, "recording").await.id;
        let instructor = centre.person("ina", Role::Instructor, None).await;
        let other = centre.person("ino", Role::Instructor, None).await;
        centre.group("A", &[&instructor], &[&ana]).await;
        let all = WatchedSessions::default();
        let (first, second) = (all.watch(id), all.watch(id));
        assert!(Arc::ptr_eq(&first, &second));
        let administrator = Scope::administrator(PersonId::at(1));
        assert_eq!(first.status_for(store, &administrator, Duration::ZERO).await, Some(SessionStatus::Queued));
        store.close().await;
        for (scope, expected) in [
            (administrator.clone(), Some(SessionStatus::Queued)),
            (instructor.scope(), Some(SessionStatus::Queued)),
            (other.scope(), None),
        ] {
            assert_eq!(second.status_for(store, &scope, HOUR).await, expected, "{scope:?}");
        }
        let newer = second.status_for(store, &administrator, Duration::ZERO).await;
        assert_eq!(newer, None, "a newer reading is impossible");
    }

    #[tokio::test]
    async fn all_views_of_a_session_share_a_reading_that_found_nothing() {
        let centre = TestCentre::with_camera_and_colours().await;
        let ana = centre.trainee("Ana").await;
        let id = centre.session(ana.id, "recording").await.id;
        let scope = Scope::administrator(PersonId::at(1));
        let (empty, closed) = (TestCentre::new().await, TestCentre::new().await);
        closed.store.close().await;
        for (store, case) in [(&empty.store, "no such session"), (&closed.store, "a store error")] {
            let watched = WatchedSessions::default().watch(id);
            assert_eq!(watched.status_for(store, &scope, Duration::ZERO).await, None, "{case}");
            assert_eq!(watched.status_for(&centre.store, &scope, HOUR).await, None, "{case}: the same reading");
            let newer = watched.status_for(&centre.store, &scope, Duration::ZERO).await;
            assert_eq!(newer, Some(SessionStatus::Queued), "{case}: a newer reading");
        }
    }

    #[tokio::test]
    async fn a_newer_reading_shows_a_lost_right_and_an_erased_session() {
        let centre = TestCentre::with_camera_and_colours().await;
        let (store, ana) = (&centre.store, centre.trainee("Ana").await);
        let id = centre.session(ana.id, "recording").await.id;
        let instructor = centre.person("ina", Role::Instructor, None).await;
        centre.group("A", &[&instructor], &[&ana]).await;
        let watched = WatchedSessions::default().watch(id);
        let (scope, administrator) = (instructor.scope(), Scope::administrator(PersonId::at(1)));
        assert!(watched.status_for(store, &scope, Duration::ZERO).await.is_some());
        let group = store.groups().list(&Scope::service()).await.unwrap().remove(0);
        let members = Members { instructors: vec![instructor.id], trainees: vec![] };
        store.groups().set_members(&Scope::service(), group.id, members).await.unwrap();
        assert_eq!(watched.status_for(store, &scope, Duration::ZERO).await, None);
        assert!(watched.status_for(store, &administrator, HOUR).await.is_some());
        store.trainees().erase(&Scope::service(), &Key::from(&ana.id)).await.unwrap();
        assert_eq!(watched.status_for(store, &administrator, Duration::ZERO).await, None);
    }

    #[test]
    fn a_session_without_views_is_forgotten() {
        let all = WatchedSessions::default();
        drop(all.watch(SessionId::at(1)));
        let _second = all.watch(SessionId::at(2));
        assert_eq!(all.0.lock().unwrap().len(), 1);
    }
}
