//! Stage of a pipeline: a value with the key that it was made from, made again when that changes.

/// A value, what it was made from, and what it was last asked to be made from.
///
/// Whoever drives a stage asks with the key as it is now, makes the value where that is new, there and then or beside the rest, and hands
/// it in with the key it was made from. A value that nobody asks for any more is thrown away.
#[derive(Clone, Debug)]
pub struct Derived<Key, Value> {
    asked: Option<Key>,
    made: Option<(Key, Value)>,
    version: u64,
}

impl<Key, Value> Default for Derived<Key, Value> {
    fn default() -> Self {
        Self {
            asked: None,
            made: None,
            version: 0,
        }
    }
}

impl<Key: Clone + PartialEq, Value> Derived<Key, Value> {
    /// Asks for the value of a key. Whether it was not asked for last, and is to be made.
    pub fn ask(&mut self, key: &Key) -> bool {
        let is_new = !self.is_asked(key);
        if is_new {
            self.asked = Some(key.clone());
        }
        is_new
    }

    /// True where that key was asked for last.
    pub fn is_asked(&self, key: &Key) -> bool {
        self.asked.as_ref() == Some(key)
    }

    /// Takes what was made of a key, if that is what was asked for last; whether it was.
    pub fn accept(&mut self, key: Key, value: Value) -> bool {
        let is_wanted = self.is_asked(&key);
        if is_wanted {
            self.made = Some((key, value));
            self.version += 1;
        }
        is_wanted
    }

    /// Asks for a key and hands in its value.
    pub fn set(&mut self, key: Key, value: Value) {
        self.ask(&key);
        self.accept(key, value);
    }

    /// Value that is there, whatever it was made from.
    pub fn get(&self) -> Option<&Value> {
        self.made.as_ref().map(|(_, value)| value)
    }

    /// Key that the value was made from.
    pub fn made_from(&self) -> Option<&Key> {
        self.made.as_ref().map(|(key, _)| key)
    }

    /// Value, if it was made from a key.
    pub fn of(&self, key: &Key) -> Option<&Value> {
        self.get().filter(|_| self.made_from() == Some(key))
    }

    /// Value, if it was made from the key that was asked for last.
    pub fn current(&self) -> Option<&Value> {
        self.asked.as_ref().and_then(|key| self.of(key))
    }

    /// Another one for each value that was made.
    pub fn version(&self) -> u64 {
        self.version
    }

    /// Lets it be made again, as if it had never been asked for: what makes it was broken off. What is there stays.
    pub fn ask_again(&mut self) {
        self.asked = None;
    }

    /// Forgets what was asked for and is not made: what is there is what was asked for last.
    pub fn drop_pending(&mut self) {
        self.asked = self.made_from().cloned();
    }

    /// Drops value and question.
    pub fn clear(&mut self) {
        self.asked = None;
        self.made = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stage_takes_its_own_result_and_no_stale_one() {
        let mut stage = Derived::default();
        assert!(stage.ask(&1) && !stage.ask(&1));
        assert!(stage.accept(1, "one"), "a preview");
        assert!(stage.accept(1, "all of one"));
        assert_eq!((stage.version(), stage.of(&1)), (2, Some(&"all of one")));
        assert!(stage.ask(&2));
        assert_eq!((stage.current(), stage.get()), (None, Some(&"all of one")));
        assert!(!stage.accept(1, "too late"));
        stage.ask_again();
        assert!(!stage.accept(2, "broken off") && stage.ask(&2));
        assert!(stage.accept(2, "two"));
        assert_eq!((stage.made_from(), stage.of(&1)), (Some(&2), None));
    }
}
