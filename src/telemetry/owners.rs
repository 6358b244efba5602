//! Whose the series of a name are, where what had the name before may still be held by somebody.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Who owns the series of which name.
#[derive(Debug, Clone, Default)]
pub(super) struct Owners(Arc<Mutex<State>>);

#[derive(Debug, Default)]
struct State {
    next: u64,
    current: BTreeMap<String, u64>,
}

/// The series of one name, until somebody else takes it.
#[derive(Debug)]
pub(super) struct Ownership {
    owners: Owners,
    name: String,
    number: u64,
}

impl Owners {
    /// Takes a name over. `begin` readies its series before anybody can look.
    pub fn take(&self, name: &str, begin: impl FnOnce()) -> Ownership {
        let mut state = self.lock();
        begin();
        state.next += 1;
        let number = state.next;
        state.current.insert(name.to_owned(), number);
        Ownership {
            owners: self.clone(),
            name: name.to_owned(),
            number,
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Ownership {
    /// The name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether nobody has taken the name over.
    pub fn holds(&self) -> bool {
        self.owners.lock().current.get(&self.name) == Some(&self.number)
    }

    /// Gives the name up; `end` takes its series away, unless they are somebody else's by now.
    pub fn give_up(&self, end: impl FnOnce()) {
        let mut state = self.owners.lock();
        if state.current.get(&self.name) == Some(&self.number) {
            state.current.remove(&self.name);
            end();
        }
    }
}
