use super::*;

/// Slots, and the waiters in the order of their starts.
struct Children {
    turns: Turns,
    begun: Arc<Mutex<Vec<(char, Turn)>>>,
}

struct Named {
    name: char,
    has_something: bool,
    begun: Arc<Mutex<Vec<(char, Turn)>>>,
}

impl Stands for Named {
    fn begin(&self, turn: Turn) -> bool {
        self.begun.lock().unwrap().push((self.name, turn));
        self.has_something
    }
}

impl Children {
    fn new(at_a_time: usize) -> Self {
        Self { turns: Turns::new(at_a_time), begun: Arc::default() }
    }

    fn stand(&self, name: char, has_something: bool) {
        self.turns.stand(Arc::new(Named { name, has_something, begun: self.begun.clone() }));
    }

    fn begun(&self) -> String {
        self.begun.lock().unwrap().iter().map(|(name, _)| name).collect()
    }

    fn turn_of(&self, name: char) -> Turn {
        self.begun.lock().unwrap().iter().find(|begun| begun.0 == name).unwrap().1
    }
}

#[test]
fn who_came_first_is_first_and_no_more_at_a_time_than_may() {
    let children = Children::new(2);
    "abcd".chars().for_each(|name| children.stand(name, true));
    assert_eq!(children.begun(), "ab");
    children.turns.over(children.turn_of('a'));
    assert_eq!(children.begun(), "abc");
    children.turns.over(children.turn_of('a'));
    assert_eq!(children.begun(), "abc", "a slot is released once");
}

#[test]
fn who_has_nothing_to_do_leaves_the_turn_to_the_next() {
    let children = Children::new(1);
    children.stand('a', true);
    children.stand('b', false);
    children.stand('c', true);
    children.turns.over(children.turn_of('a'));
    assert_eq!(children.begun(), "abc");
    children.stand('d', true);
    assert_eq!(children.begun(), "abc", "c holds the slot");
}

#[test]
fn nobody_waits_for_a_child_that_is_stuck() {
    let children = Children::new(1);
    let began = Instant::now();
    children.stand('a', true);
    children.stand('b', true);
    while children.begun() == "a" {
        children.turns.go_on();
    }
    assert!(began.elapsed() >= LONGEST);
    children.stand('c', true);
    children.turns.over(children.turn_of('a'));
    assert_eq!(children.begun(), "ab", "a slot that timed out is not released again");
}
