//! Which properties of the vertex and face elements mean what, and how many bytes
//! records need at least.

use super::header::{Element, Encoding, Header, Kind, Scalar};
use super::malformed;
use crate::ReadError;

/// Property indices of a vertex record.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VertexSlots {
    pub(super) position: [usize; 3],
    pub(super) normal: Option<[usize; 3]>,
    pub(super) color: Option<ColorSlots>,
    pub(super) coordinate: Option<[usize; 2]>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct ColorSlots {
    /// Red, green, blue.
    pub(super) channels: [usize; 3],
    pub(super) alpha: Option<usize>,
    /// The value of full brightness, and of full opacity.
    pub(super) max: f64,
    pub(super) alpha_max: f64,
}

impl VertexSlots {
    pub(super) fn of(element: &Element) -> Result<Self, ReadError> {
        let scalar = |names: &[&str]| {
            element
                .find(names)
                .filter(|&index| matches!(element.properties[index].kind, Kind::Scalar(_)))
        };
        let axis = |name: &str| {
            scalar(&[name])
                .ok_or_else(|| malformed(format!("the vertices have no property `{name}`")))
        };
        let pair = |u: &str, v: &str| Some([scalar(&[u])?, scalar(&[v])?]);
        let normal = || Some([scalar(&["nx"])?, scalar(&["ny"])?, scalar(&["nz"])?]);
        let color = || {
            let channels = [
                scalar(&["red", "diffuse_red", "r"])?,
                scalar(&["green", "diffuse_green", "g"])?,
                scalar(&["blue", "diffuse_blue", "b"])?,
            ];
            let alpha = scalar(&["alpha", "diffuse_alpha", "a"]);
            let max = |index: usize| match element.properties[index].kind {
                Kind::Scalar(scalar) => scalar.channel_max(),
                Kind::List { .. } => 255.0,
            };
            let alpha_max = alpha.map_or(255.0, max);
            Some(ColorSlots {
                channels,
                alpha,
                max: max(channels[0]),
                alpha_max,
            })
        };
        Ok(Self {
            position: [axis("x")?, axis("y")?, axis("z")?],
            normal: normal(),
            color: color(),
            coordinate: [("s", "t"), ("u", "v"), ("texture_u", "texture_v")]
                .into_iter()
                .find_map(|(u, v)| pair(u, v)),
        })
    }
}

/// The property of a face record that lists its corners.
pub(super) fn corner_list(element: &Element) -> Result<usize, ReadError> {
    let index = element
        .find(&["vertex_indices", "vertex_index"])
        .ok_or_else(|| {
            malformed("the faces have no list property `vertex_indices` or `vertex_index`")
        })?;
    match element.properties[index].kind {
        Kind::List { item, .. } if item.is_integer() => Ok(index),
        _ => Err(malformed(
            "the property that lists a face's vertices must be a list of integers",
        )),
    }
}

/// The bytes that one record needs at least, its lists being empty.
pub(super) fn least_record_size(element: &Element, encoding: Encoding) -> u64 {
    let sizes = element
        .properties
        .iter()
        .map(|property| match (encoding, property.kind) {
            // A digit and what separates it from the next.
            (Encoding::Ascii, _) => 2,
            (_, Kind::Scalar(scalar) | Kind::List { count: scalar, .. }) => scalar.size() as u64,
        });
    sizes.sum()
}

/// The bytes that every record takes, if they have no lists.
pub(super) fn fixed_record_size(element: &Element) -> Option<usize> {
    element
        .properties
        .iter()
        .map(|property| match property.kind {
            Kind::Scalar(scalar) => Some(scalar.size()),
            Kind::List { .. } => None,
        })
        .sum()
}

/// The type and byte offset of each property of a record without lists.
pub(super) fn columns(element: &Element) -> Vec<(Scalar, usize)> {
    let mut offset = 0;
    let mut columns = Vec::with_capacity(element.properties.len());
    for property in &element.properties {
        if let Kind::Scalar(scalar) = property.kind {
            columns.push((scalar, offset));
            offset += scalar.size();
        }
    }
    columns
}

/// Compares what the header promises with the length of the body, before anything
/// is allocated for it.
pub(super) fn check_promises(header: &Header<'_>) -> Result<(), ReadError> {
    let mut room = header.body.len() as u64;
    if header.encoding == Encoding::Ascii {
        // The last token needs no separator.
        room += 1;
    }
    for element in &header.elements {
        let size = least_record_size(element, header.encoding);
        let needed = size.saturating_mul(element.count);
        if needed > room {
            return Err(broken_promise(header, element, needed, room));
        }
        room -= needed;
    }
    Ok(())
}

fn broken_promise(header: &Header<'_>, element: &Element, needed: u64, room: u64) -> ReadError {
    let promised = element.counted();
    let verb = if element.count == 1 { "needs" } else { "need" };
    let body = header.body.len() as u64;
    let left = room.min(body);
    let rest = if left == body {
        format!("the body has {body}")
    } else {
        format!("only {left} of the body's {body} bytes are left for them")
    };
    let fixed_size = fixed_record_size(element).filter(|_| header.encoding != Encoding::Ascii);
    let message = match fixed_size.map(|size| left.checked_div(size as u64)) {
        Some(Some(record)) => format!(
            "the header promises {promised}, which {verb} {needed} bytes; {rest}, so it ends \
             inside {} {record}",
            element.name
        ),
        _ => {
            format!("the header promises {promised}, which {verb} at least {needed} bytes; {rest}")
        }
    };
    malformed(message)
}
