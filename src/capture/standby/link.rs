//! The connection of an agent that stands by: it reports the state of the box every two seconds and after each change, and
//! carries out the server's commands.

use std::time::Duration;

use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use tokio::time::{Instant, MissedTickBehavior, interval, sleep, timeout};
use tokio_tungstenite::tungstenite::Message;

use super::clock::ServerClock;
use super::{Facts, Standby};
use crate::capture::connection::{DisconnectOutcome, Socket, is_same_reason, outcome_of_close_code};
use crate::domain::box_agent::messages::{AgentMessage, CheckInEnd, CheckInRefusal, CheckedIn, StartCommand, ToAgent};
use crate::domain::box_agent::state::ClockState;
use crate::domain::box_agent::{PROTOCOL, STATE_INTERVAL};

/// Program and version, for people.
pub(super) const PROGRAM: &str = concat!("trocar agent ", env!("CARGO_PKG_VERSION"));
/// Pause before the next attempt to connect: short, because pages shall show within seconds that the box is back.
const PAUSE: Duration = Duration::from_secs(2);
/// Pause after a refusal that only a person can end, such as a withdrawn token.
const REFUSED_PAUSE: Duration = Duration::from_secs(10);
/// Longest silence of the server, which answers every state.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(8);
/// How long the server may take to receive a message.
const SEND_TIMEOUT: Duration = Duration::from_secs(5);

type Sink = SplitSink<Socket, Message>;

impl Standby {
    /// Connects again and again.
    pub(super) async fn stay_connected(self) {
        let mut last = String::new();
        loop {
            let ended = match self.parts().server.connect_in_time("agent-connection").await {
                Ok(socket) => self.talk(socket).await,
                Err(ended) => ended,
            };
            let is_refused = matches!(ended, DisconnectOutcome::Refused(_));
            let (why, pause) = match ended {
                DisconnectOutcome::Retry { why, .. } => (why, PAUSE),
                DisconnectOutcome::Refused(why) => (why, REFUSED_PAUSE),
                DisconnectOutcome::Complete(_) | DisconnectOutcome::Empty => ("the connection was cut".into(), PAUSE),
            };
            if !is_same_reason(&why, &last) {
                tracing::warn!(why, "no connection to the server; recordings go on into the spool");
            }
            last.clone_from(&why);
            {
                let mut facts = self.facts();
                (facts.is_connected, facts.is_refused, facts.trouble) = (false, is_refused, why);
                facts.set_check_in_address(None, None);
            }
            self.note_change();
            self.end_idle_check_in();
            sleep(pause).await;
        }
    }

    /// Uses one connection until it ends.
    async fn talk(&self, socket: Socket) -> DisconnectOutcome {
        let (mut sink, mut stream) = socket.split();
        let hello = AgentMessage::Hello { protocol: PROTOCOL, program: PROGRAM.to_owned() };
        if let Err(ended) = send(&mut sink, &hello).await {
            return ended;
        }
        let mut outbox = self.0.waiting.lock().await;
        while outbox.try_recv().is_ok() {} // of an earlier connection
        let mut states = interval(STATE_INTERVAL);
        states.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut changes = self.0.changes.subscribe();
        let mut accepted = self.parts().agent.accepted();
        let mut silent_at = Instant::now() + SILENCE_TIMEOUT;
        loop {
            let sent = tokio::select! {
                received = receive(&mut stream) => {
                    silent_at = Instant::now() + SILENCE_TIMEOUT;
                    match received {
                        Ok(Some(message)) => self.handle(message, &mut sink).await,
                        Ok(None) => Ok(()),
                        Err(ended) => return ended,
                    }
                }
                message = outbox.recv() => match message {
                    Some(message) => send(&mut sink, &message).await,
                    None => Ok(()), // the sender lives as long as this
                },
                _ = states.tick() => {
                    self.end_idle_check_in();
                    self.send_state(&mut sink).await
                }
                _ = changes.changed() => self.send_state(&mut sink).await,
                _ = accepted.changed() => {
                    self.note_change(); // for the screen
                    Ok(())
                }
                () = tokio::time::sleep_until(silent_at) => {
                    Err(retry(format!("the server was silent for {SILENCE_TIMEOUT:?}")))
                }
            };
            if let Err(ended) = sent {
                return ended;
            }
        }
    }

    async fn send_state(&self, sink: &mut Sink) -> Result<(), DisconnectOutcome> {
        let state = Box::new(self.state());
        send(sink, &AgentMessage::State { sent_at_ms: self.parts().clock.now_ms(), state }).await
    }

    async fn handle(&self, message: ToAgent, sink: &mut Sink) -> Result<(), DisconnectOutcome> {
        match message {
            ToAgent::Welcome { box_name, light_reference, max_file_bytes, token_expires_at } => {
                if let Some(expires_at) = token_expires_at {
                    tracing::warn!(expires_at, "the token expires soon: make another and put it into the token file");
                }
                tracing::info!(box_name, "standing by");
                let unconfirmed = {
                    let mut facts = self.facts();
                    (facts.box_name, facts.light_reference) = (box_name, Some(light_reference));
                    (facts.is_connected, facts.is_refused) = (true, false);
                    facts.max_file_bytes = max_file_bytes;
                    facts.trouble.clear();
                    let left = facts.left.map(|_| AgentMessage::CheckOut);
                    left.into_iter().chain(facts.chosen.map(|task| AgentMessage::Task { task })).collect::<Vec<_>>()
                };
                for message in unconfirmed {
                    send(sink, &message).await?;
                }
            }
            ToAgent::Time { sent_at_ms, server_ms } => {
                let clock = ClockState::of_exchange(sent_at_ms, server_ms, self.parts().clock.now_ms());
                if self.note_clock(clock) {
                    self.0.spool_changed.notify_one(); // recordings may wait for it
                    self.note_change();
                }
                return Ok(()); // the next state has it
            }
            ToAgent::LightReference { light_reference } => self.facts().light_reference = Some(light_reference),
            ToAgent::Start(StartCommand { command, recording, trainee, task, on_movement }) => {
                let started = match (on_movement, trainee, task) {
                    (true, Some(trainee), Some(task)) => self.await_movement(trainee, task),
                    (_, trainee, task) => {
                        self.end_awaited_start();
                        self.start(recording, trainee, task)
                    }
                };
                let refused = started.err().map(|why| why.to_string());
                return self.answer(command, refused, sink).await;
            }
            ToAgent::Stop { command, target } => {
                let stopped = match target {
                    Some(target) => self.stop_target(target).await,
                    None => self.stop().await,
                };
                let refused = stopped.err().map(|why| why.to_string());
                return self.answer(command, refused, sink).await;
            }
            ToAgent::CheckedIn { by, ended } => {
                if !self.note_checked_in(by.map(|by| *by), ended) {
                    return Ok(());
                }
            }
            ToAgent::CheckInRefused { why, wait_s } => {
                let mut facts = self.facts();
                facts.refusal = Some((why, wait_s));
                let is_other_person = why == CheckInRefusal::NoConsent;
                facts.needs_unnamed_button |= is_other_person;
                drop(facts);
                if is_other_person {
                    self.end_awaited_start(); // the person at the box may be this one
                }
            }
            ToAgent::PhoneCheckInRefused { refused_at_ms } => self.note_phone_refusal(refused_at_ms),
            ToAgent::CheckInAddress { address } => self.facts().set_check_in_address(Some(address), None),
            ToAgent::NoCheckInAddress { server } => self.facts().set_check_in_address(None, Some(server)),
        }
        self.note_change();
        Ok(())
    }

    /// The server says who is checked in. False if it does not know yet that the trainee has left.
    pub(super) fn note_checked_in(&self, by: Option<CheckedIn>, ended: Option<CheckInEnd>) -> bool {
        let mut facts = self.facts();
        let trainee = |checked_in: &CheckedIn| checked_in.trainee.id;
        if by.is_some() && by.as_ref().map(trainee) == facts.left {
            return false; // not yet confirmed
        }
        facts.left = None;
        let chosen = facts.chosen.filter(|_| by.as_ref().map(trainee) == facts.checked_in.as_ref().map(trainee));
        let unconfirmed =
            chosen.filter(|chosen| by.as_ref().and_then(|by| by.task.as_ref()).is_none_or(|task| task.id != *chosen));
        facts.chosen = unconfirmed;
        let by = by.map(|mut by| {
            let kept = by.tasks.iter().find(|task| Some(task.id) == unconfirmed).cloned();
            by.task = kept.or(by.task.take());
            by
        });
        let is_other = by.as_ref().map(trainee) != facts.checked_in.as_ref().map(trainee);
        let has_task = |checked_in: Option<&CheckedIn>| checked_in.is_some_and(|by| by.task.is_some());
        let is_ready = has_task(by.as_ref()) && (is_other || !has_task(facts.checked_in.as_ref()));
        if is_other {
            facts.active = Some(Instant::now());
        }
        // Repeated to an agent that knows it already, it would undo what was chosen at the box since.
        let is_news = facts.checked_in.is_some() || !facts.knows_check_in;
        if by.is_some() && is_other {
            (facts.check_in_end, facts.last_unnamed, facts.needs_unnamed_button) = (None, None, false);
            (facts.phone_refusal, facts.start_failed) = (None, None);
        } else if by.is_none()
            && let Some(why) = ended.filter(|_| is_news)
        {
            (facts.check_in_end, facts.needs_unnamed_button) = (Some((why, Instant::now())), true);
        }
        facts.knows_check_in = true;
        (facts.checked_in, facts.refusal) = (by, None);
        drop(facts);
        if is_other {
            self.end_awaited_start_of_another();
        }
        if is_ready {
            self.await_movement_if_automatic();
        }
        true
    }

    /// A check-in with the phone was refused. Repeated to an agent that knows it already, it would undo what was done at the
    /// box since.
    fn note_phone_refusal(&self, refused_at_ms: i64) {
        let is_new = {
            let mut facts = self.facts();
            let is_new = facts.phone_refusal.is_none_or(|(known, _)| known != refused_at_ms);
            if is_new {
                facts.phone_refusal = Some((refused_at_ms, Instant::now()));
                facts.needs_unnamed_button = true;
            }
            is_new
        };
        if is_new {
            self.end_awaited_start(); // the movement may be that of the person who was refused
        }
    }

    /// Sends the state before the answer, so that a page that waits for the answer sees the new state.
    async fn answer(&self, command: u64, refused: Option<String>, sink: &mut Sink) -> Result<(), DisconnectOutcome> {
        self.send_state(sink).await?;
        send(sink, &AgentMessage::Done { command, refused }).await
    }

    /// Keeps the best of the measured offsets, until the clock is set. True if it is the first one.
    pub(super) fn note_clock(&self, measured: ClockState) -> bool {
        let now = self.computer_time();
        let mut facts = self.facts();
        let is_first = facts.clock.is_none();
        let was_wrong = facts.clock.is_some_and(|known| known.state(now).is_wrong());
        facts.clock = Some(facts.clock.map_or(ServerClock::new(measured, now), |known| known.better(measured, now)));
        drop(facts);
        if measured.is_wrong() && !was_wrong {
            let offset_s = measured.offset_ms / 1000;
            tracing::warn!(offset_s, "the clock of this computer is wrong: set it; recordings get corrected times");
        }
        is_first
    }
}

impl Facts {
    /// What a phone opens to check in, or the server's address if a phone cannot open it.
    fn set_check_in_address(&mut self, address: Option<String>, unreachable_server: Option<String>) {
        (self.check_in_address, self.unreachable_server) = (address, unreachable_server);
    }
}

/// The server's next message; `None` for one that is not for an agent of this version.
async fn receive(stream: &mut SplitStream<Socket>) -> Result<Option<ToAgent>, DisconnectOutcome> {
    match stream.next().await {
        None => Err(retry("the connection was cut".into())),
        Some(Err(error)) => Err(retry(error.to_string())),
        Some(Ok(Message::Text(text))) => Ok(serde_json::from_str(&text).ok()),
        Some(Ok(Message::Close(frame))) => {
            let (code, why) = frame.map_or((1005, String::new()), |f| (f.code.into(), f.reason.to_string()));
            Err(outcome_of_close_code(code, &why))
        }
        Some(Ok(_)) => Ok(None),
    }
}

async fn send(sink: &mut Sink, message: &AgentMessage) -> Result<(), DisconnectOutcome> {
    let text = serde_json::to_string(message).unwrap_or_default(); // plain data always serialises
    match timeout(SEND_TIMEOUT, sink.send(Message::text(text))).await {
        Ok(Ok(())) => Ok(()),
        Ok(Err(error)) => Err(retry(error.to_string())),
        Err(_) => Err(retry("the server does not read".into())),
    }
}

fn retry(why: String) -> DisconnectOutcome {
    DisconnectOutcome::Retry { why, was_welcome: false }
}
