//! Numbers in messages to people.

/// A count with what is counted: `1 vertex`, `2 vertices`. `one` is the singular.
#[must_use]
pub fn counted(count: u64, one: &str) -> String {
    if count == 1 {
        format!("1 {one}")
    } else {
        format!("{count} {}", plural(one))
    }
}

/// The plural of a noun, as far as meshes need it.
#[must_use]
pub fn plural(one: &str) -> String {
    let irregular = [("vertex", "vertices"), ("index", "indices")];
    for (singular, plural) in irregular {
        if let Some(start) = one.strip_suffix(singular) {
            return format!("{start}{plural}");
        }
    }
    format!("{one}s")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_singular_and_all_else_is_plural() {
        assert_eq!(counted(0, "face"), "0 faces");
        assert_eq!(counted(1, "vertex"), "1 vertex");
        assert_eq!(counted(2, "sparse index"), "2 sparse indices");
    }
}
