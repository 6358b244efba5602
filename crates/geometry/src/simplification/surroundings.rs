//! The faces around an edge, written down once for all that is asked of them.

use super::faces_around::MAX_VALENCE;

/// A face as seen from one of its corners.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sector {
    pub face: u32,
    /// The corner that follows in the face's direction.
    pub next: u32,
    /// The one after that.
    pub last: u32,
}

/// The faces around an edge that may be collapsed.
pub(super) struct Surroundings {
    /// The edge: the end that stays, called a, and the one that goes, b.
    pub edge: (u32, u32),
    /// The first faces on the edge, each with its corner across it.
    vanishing: [(u32, u32); MOST_VANISHING],
    /// How many there are, or more than that array has room for.
    vanishing_count: usize,
    /// All others: those around a, then those around b.
    staying: Vec<Sector>,
    pub staying_count: usize,
    pub staying_at_a: usize,
}

/// One more than may be.
const MOST_VANISHING: usize = 3;

impl Default for Surroundings {
    fn default() -> Self {
        Self {
            edge: (0, 0),
            vanishing: [(0, 0); MOST_VANISHING],
            vanishing_count: 0,
            // What is written down last may turn out not to stay.
            staying: vec![Sector::default(); MAX_VALENCE + 1],
            staying_count: 0,
            staying_at_a: 0,
        }
    }
}

impl Surroundings {
    /// Starts with another edge, whose ends have at most [`MAX_VALENCE`] faces together.
    pub fn start(&mut self, edge: (u32, u32)) {
        self.edge = edge;
        self.vanishing_count = 0;
        self.staying_count = 0;
        self.staying_at_a = 0;
    }

    /// Adds a face around a.
    #[inline]
    pub fn add_at_a(&mut self, sector: Sector) {
        let (_, b) = self.edge;
        let Sector { face, next, last } = sector;
        let is_on_edge = (next == b) | (last == b);
        let place = self.vanishing_count.min(MOST_VANISHING - 1);
        self.vanishing[place] = (face, if next == b { last } else { next });
        self.vanishing_count += usize::from(is_on_edge);
        self.add(sector, !is_on_edge);
    }

    /// Adds a face around b.
    #[inline]
    pub fn add_at_b(&mut self, sector: Sector) {
        let (a, _) = self.edge;
        self.add(sector, (sector.next != a) & (sector.last != a));
    }

    #[inline]
    fn add(&mut self, sector: Sector, stays: bool) {
        self.staying[self.staying_count] = sector;
        self.staying_count += usize::from(stays);
    }

    /// The faces on the edge, each with its corner across it: all of them, or three.
    pub fn vanishing(&self) -> &[(u32, u32)] {
        &self.vanishing[..self.vanishing_count.min(MOST_VANISHING)]
    }

    /// The others around a and around b.
    pub fn staying(&self) -> [&[Sector]; 2] {
        let (at_a, at_b) = self.staying[..self.staying_count].split_at(self.staying_at_a);
        [at_a, at_b]
    }
}
