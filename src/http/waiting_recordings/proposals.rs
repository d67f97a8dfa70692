//! Proposals for recordings that wait for a name, from the names of files and folders.

use super::RecordingProposal;
use crate::domain::name_matcher::NameMatcher;
use crate::domain::scope::Scope;
use crate::http::error::HandlerResult;
use crate::http::show::NamedReference;
use crate::http::state::App;
use crate::store::{ProposableThing, ProposableThings, WaitingRecordingRecord};

/// The trainees, tasks and boxes that may be proposed to a caller.
#[derive(Default)]
pub(super) struct Proposer {
    trainees: KnownNames,
    tasks: KnownNames,
    boxes: KnownNames,
}

#[derive(Default)]
struct KnownNames {
    things: Vec<NamedReference>,
    matcher: NameMatcher,
}

impl Proposer {
    /// Reads what this caller sees.
    pub(super) async fn new(app: &App, scope: &Scope) -> HandlerResult<Self> {
        let ProposableThings { trainees, tasks, boxes } = app.store.waiting_recordings().proposable(scope).await?;
        let [trainees, tasks, boxes] = [trainees, tasks, boxes].map(KnownNames::from);
        Ok(Self { trainees, tasks, boxes })
    }

    /// What the names of this recording speak of.
    pub(super) fn propose(&self, of: &WaitingRecordingRecord) -> RecordingProposal {
        let folders = of.folder.as_deref().unwrap_or_default().split('/');
        let names: Vec<&str> = folders.chain([of.filename.as_str()]).collect();
        RecordingProposal {
            trainee: self.trainees.find(&names),
            task: self.tasks.find(&names),
            in_box: self.boxes.find(&names),
        }
    }
}

impl From<Vec<ProposableThing>> for KnownNames {
    fn from(things: Vec<ProposableThing>) -> Self {
        let named = |ProposableThing { id, name, code }| NamedReference { id, name, code };
        let things: Vec<NamedReference> = things.into_iter().map(named).collect();
        let matcher = NameMatcher::new(things.iter().map(|thing| (thing.code.as_str(), thing.name.as_str())));
        Self { things, matcher }
    }
}

impl KnownNames {
    fn find(&self, names: &[&str]) -> Option<NamedReference> {
        self.matcher.find(names).and_then(|index| self.things.get(index)).cloned()
    }
}
