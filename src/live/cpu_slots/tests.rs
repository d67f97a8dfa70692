use super::*;

/// Slots, and the waiters in the order of their starts.
struct Children {
    slots: CpuSlots,
    begun: Arc<Mutex<Vec<(char, SlotId)>>>,
}

struct Named {
    name: char,
    has_something: bool,
    begun: Arc<Mutex<Vec<(char, SlotId)>>>,
}

impl Waiter for Named {
    fn start(&self, slot: SlotId) -> bool {
        self.begun.lock().unwrap().push((self.name, slot));
        self.has_something
    }
}

impl Children {
    fn new(at_a_time: usize) -> Self {
        Self { slots: CpuSlots::new(at_a_time), begun: Arc::default() }
    }

    fn stand(&self, name: char, has_something: bool) {
        self.slots.enqueue(Arc::new(Named { name, has_something, begun: self.begun.clone() }));
    }

    fn begun(&self) -> String {
        self.begun.lock().unwrap().iter().map(|(name, _)| name).collect()
    }

    fn slot_of(&self, name: char) -> SlotId {
        self.begun.lock().unwrap().iter().find(|begun| begun.0 == name).unwrap().1
    }
}

#[test]
fn waiters_start_in_order_and_never_more_than_there_are_slots() {
    let children = Children::new(2);
    "abcd".chars().for_each(|name| children.stand(name, true));
    assert_eq!(children.begun(), "ab");
    children.slots.release(children.slot_of('a'));
    assert_eq!(children.begun(), "abc");
    children.slots.release(children.slot_of('a'));
    assert_eq!(children.begun(), "abc", "a slot is released once");
}

#[test]
fn a_waiter_without_work_leaves_the_slot_to_the_next() {
    let children = Children::new(1);
    children.stand('a', true);
    children.stand('b', false);
    children.stand('c', true);
    children.slots.release(children.slot_of('a'));
    assert_eq!(children.begun(), "abc");
    children.stand('d', true);
    assert_eq!(children.begun(), "abc", "c holds the slot");
}

#[test]
fn a_stuck_child_loses_its_slot() {
    let children = Children::new(1);
    let began = Instant::now();
    children.stand('a', true);
    children.stand('b', true);
    while children.begun() == "a" {
        children.slots.start_next();
    }
    assert!(began.elapsed() >= MAX_SLOT_TIME);
    children.stand('c', true);
    children.slots.release(children.slot_of('a'));
    assert_eq!(children.begun(), "ab", "a slot that timed out is not released again");
}
