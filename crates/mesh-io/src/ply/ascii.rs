//! ASCII bodies: one record a line.

use super::binary::list_length;
use super::header::{Element, Kind};
use super::malformed;
use super::read::{Role, Sinks};
use crate::ReadError;
use crate::cursor::{Lines, Tokens, number, shown};

pub(super) struct AsciiBody<'a> {
    lines: Lines<'a>,
    scalars: Vec<f64>,
    corners: Vec<f64>,
}

impl<'a> AsciiBody<'a> {
    pub(super) fn new(body: &'a [u8], first_line: usize) -> Self {
        Self {
            lines: Lines::new(body, first_line),
            scalars: Vec::new(),
            corners: Vec::new(),
        }
    }

    pub(super) fn read(
        &mut self,
        role: Role,
        element: &Element,
        sinks: &mut Sinks<'_>,
    ) -> Result<(), ReadError> {
        if element.properties.is_empty() {
            return Ok(());
        }
        for record in 0..element.count {
            let (line, text) = self
                .lines
                .find(|(_, text)| !text.trim_ascii().is_empty())
                .ok_or_else(|| {
                    let (name, count) = (&element.name, element.count);
                    malformed(format!("the file ends before {name} {record} of {count}"))
                })?;
            if role != Role::Other {
                self.record(element, record, (line, text), sinks.corner_list)?;
            }
            match role {
                Role::Vertex => sinks
                    .vertices
                    .push(|index| self.scalars[index], Some(line))?,
                Role::Face => sinks.faces.push(&self.corners, Some(line))?,
                Role::Other => {}
            }
        }
        Ok(())
    }

    /// Reads one record into `scalars`, one entry per property, and `corners`.
    fn record(
        &mut self,
        element: &Element,
        record: u64,
        (line, text): (usize, &[u8]),
        corner_list: usize,
    ) -> Result<(), ReadError> {
        let mut tokens = Tokens::new(text);
        let mut next = || {
            let token = tokens.next().ok_or_else(|| {
                malformed(format!(
                    "line {line}: {} {record} has too few numbers",
                    element.name
                ))
            })?;
            number(token)
                .ok_or_else(|| malformed(format!("line {line}: {} is not a number", shown(token))))
        };
        self.scalars.clear();
        for (index, property) in element.properties.iter().enumerate() {
            match property.kind {
                Kind::Scalar(_) => self.scalars.push(next()?),
                Kind::List { .. } => {
                    let length = list_length(next()?, element, record)?;
                    if index == corner_list {
                        self.corners.clear();
                    }
                    // The tokens run out long before a hostile length does.
                    for _ in 0..length {
                        let item = next()?;
                        if index == corner_list {
                            self.corners.push(item);
                        }
                    }
                    self.scalars.push(0.0);
                }
            }
        }
        match tokens.next() {
            None => Ok(()),
            Some(token) => Err(malformed(format!(
                "line {line}: {} {record} has more numbers than the header says, from {} on",
                element.name,
                shown(token)
            ))),
        }
    }
}
