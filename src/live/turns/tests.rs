use std::sync::{Arc, Mutex};
use std::time::Instant;

use tokio::sync::Notify;
use tokio::task::yield_now;

use super::*;

/// Children that stand in one line, and in which order they began.
#[derive(Clone)]
struct Line {
    turns: Arc<Turns>,
    begun: Arc<Mutex<Vec<char>>>,
}

impl Line {
    fn new(at_a_time: usize) -> Self {
        Self { turns: Arc::new(Turns::new(at_a_time)), begun: Arc::default() }
    }

    /// A child that stands behind all others and is done when it is told so.
    async fn joined_by(&self, name: char) -> Arc<Notify> {
        let (line, done) = (self.clone(), Arc::new(Notify::new()));
        let until = done.clone();
        tokio::spawn(async move {
            line.turns
                .take(|| {
                    line.begun.lock().unwrap().push(name);
                    async move { until.notified().await }
                })
                .await;
        });
        yield_now().await;
        done
    }

    fn begun(&self) -> String {
        self.begun.lock().unwrap().iter().collect()
    }
}

#[tokio::test]
async fn who_came_first_is_first_and_no_more_at_a_time_than_may() {
    let line = Line::new(2);
    let first = line.joined_by('a').await;
    for name in ['b', 'c', 'd'] {
        line.joined_by(name).await;
    }
    assert_eq!(line.begun(), "ab");
    first.notify_one();
    yield_now().await;
    yield_now().await;
    assert_eq!(line.begun(), "abc");
}

#[tokio::test]
async fn nobody_waits_for_a_child_that_is_stuck() {
    let line = Line::new(1);
    line.joined_by('a').await;
    let began = Instant::now();
    line.turns.take(|| async {}).await;
    assert!(began.elapsed() >= LONGEST);
}
