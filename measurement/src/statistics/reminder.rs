//! Reminders to practise again. Skill is kept better with refreshers one and three months after proficiency (95 against
//! 90 % at six months: Stefanidis 2006; METHOD 7.3), and skill lost in a month returns in 40 minutes.

/// A day, in ms.
const DAY_MS: i64 = 86_400_000;

/// Days from the declaration of proficiency to each refresher: one month and three.
pub const REFRESHER_DAYS: [i64; 2] = [30, 91];

/// A session at most this many days before a refresher is due already counts as the refresher.
pub const EARLY_DAYS: i64 = 7;

/// One reminder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reminder {
    /// When the refresher is due, in ms since 1970.
    pub due_ms: i64,
    /// Its state.
    pub state: ReminderState,
}

/// The state of a reminder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReminderState {
    /// Not due yet.
    Ahead,
    /// Due, and not practised since.
    Due,
    /// Practised at this time, in ms since 1970.
    Done(i64),
}

/// The two reminders of a trainee who was declared proficient, from the times of all measured sessions of the task, in
/// any order, and the present time (all in ms since 1970).
///
/// A session counts for one refresher: the first that is open at that time. A trainee who has relapsed has no
/// reminders: they practise anyway.
pub fn reminders(declared_ms: i64, practised_ms: &[i64], now_ms: i64) -> [Reminder; 2] {
    let mut practised: Vec<i64> = practised_ms.iter().copied().filter(|at| *at <= now_ms).collect();
    practised.sort_unstable();
    let mut practised = practised.into_iter().peekable();
    REFRESHER_DAYS.map(|days| {
        let due_ms = declared_ms.saturating_add(days * DAY_MS);
        let opens_ms = due_ms.saturating_sub(EARLY_DAYS * DAY_MS);
        while practised.next_if(|at| *at < opens_ms).is_some() {}
        let state = match practised.next() {
            Some(at) => ReminderState::Done(at),
            None if now_ms >= due_ms => ReminderState::Due,
            None => ReminderState::Ahead,
        };
        Reminder { due_ms, state }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn states(practised_days: &[i64], now_day: i64) -> [ReminderState; 2] {
        let practised: Vec<i64> = practised_days.iter().map(|day| 1_000 + day * DAY_MS).collect();
        reminders(1_000, &practised, 1_000 + now_day * DAY_MS).map(|reminder| reminder.state)
    }

    fn done(day: i64) -> ReminderState {
        ReminderState::Done(1_000 + day * DAY_MS)
    }

    #[test]
    fn refreshers_are_due_after_one_and_three_months() {
        assert_eq!(states(&[], 0), [ReminderState::Ahead, ReminderState::Ahead]);
        assert_eq!(states(&[], 29), [ReminderState::Ahead, ReminderState::Ahead]);
        assert_eq!(states(&[], 30), [ReminderState::Due, ReminderState::Ahead]);
        assert_eq!(states(&[], 91), [ReminderState::Due, ReminderState::Due]);
        assert_eq!(reminders(1_000, &[], 0).map(|reminder| reminder.due_ms), [2_592_001_000, 7_862_401_000]);
    }

    #[test]
    fn practice_near_or_after_a_refresher_is_it_and_practice_long_before_is_not() {
        assert_eq!(states(&[-3, 2, 22], 40), [ReminderState::Due, ReminderState::Ahead]);
        assert_eq!(states(&[22, 23, 31], 40), [done(23), ReminderState::Ahead]);
        assert_eq!(states(&[90, 35], 95), [done(35), done(90)]);
        assert_eq!(states(&[60], 95), [done(60), ReminderState::Due]);
        assert_eq!(states(&[95], 100), [done(95), ReminderState::Due], "one session after both is one refresher");
        assert_eq!(states(&[35], 34), [ReminderState::Due, ReminderState::Ahead], "a session of the future is none");
    }
}
