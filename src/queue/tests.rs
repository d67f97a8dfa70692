//! Laws of the queue, on a clock that the test turns.
