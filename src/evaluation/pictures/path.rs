//! SVG path data in few bytes.

/// The data of a path: relative moves in whole units, without spaces that say nothing.
#[derive(Debug, Clone, Default)]
pub(super) struct Path {
    data: String,
    at: [i32; 2],
}

impl Path {
    /// Adds an open line through `points`. A path that is filled is closed by that.
    pub fn polyline(&mut self, points: &[[i32; 2]]) {
        for (index, point) in points.iter().enumerate() {
            let [dx, dy] = [point[0] - self.at[0], point[1] - self.at[1]];
            // What follows the pair of a move are lines.
            let separator = match index {
                0 => "m",
                _ if dx < 0 => "",
                _ => " ",
            };
            let between = if dy < 0 { "" } else { " " };
            self.data.push_str(&format!("{separator}{dx}{between}{dy}"));
            self.at = *point;
        }
    }

    /// Adds a place where a stroke with round ends leaves a dot.
    pub fn dot(&mut self, place: [i32; 2]) {
        self.polyline(&[place]);
        self.data.push_str("h0");
    }

    /// As an element of class `class`; nothing if nothing was added.
    pub fn element(&self, class: &str) -> String {
        if self.data.is_empty() {
            return String::new();
        }
        format!("<path class=\"{class}\" d=\"{}\"/>\n", self.data)
    }
}

/// Covers `edges`, each a pair of vertices, with lines of as many of them as it finds.
pub(super) fn chains(edges: &[[u32; 2]]) -> Vec<Vec<u32>> {
    let vertex_count = edges
        .iter()
        .flatten()
        .max()
        .map_or(0, |last| *last as usize + 1);
    let mut edges_at = vec![Vec::new(); vertex_count];
    for (index, edge) in edges.iter().enumerate() {
        for end in edge {
            edges_at[*end as usize].push(index);
        }
    }
    let mut is_drawn = vec![false; edges.len()];
    let mut chains = Vec::new();
    for start in 0..edges.len() {
        if is_drawn[start] {
            continue;
        }
        let mut chain = vec![edges[start][0]];
        let mut next = Some(start);
        while let Some(index) = next {
            is_drawn[index] = true;
            let [a, b] = edges[index];
            let end = if chain.last() == Some(&a) { b } else { a };
            chain.push(end);
            let around = edges_at[end as usize].iter().copied();
            next = around.into_iter().find(|index| !is_drawn[*index]);
        }
        chains.push(chain);
    }
    chains
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_is_told_relative_to_the_one_before() {
        let mut path = Path::default();
        path.polyline(&[[10, 20], [13, 18], [9, 30]]);
        path.dot([8, 30]);
        path.polyline(&[[0, 0], [0, -1]]);
        assert_eq!(
            path.element("a"),
            "<path class=\"a\" d=\"m10 20 3-2-4 12m-1 0h0m-8-30 0-1\"/>\n"
        );
        assert_eq!(Path::default().element("a"), "");
    }

    #[test]
    fn every_edge_is_in_one_chain() {
        let edges = [[0, 1], [1, 2], [0, 2], [2, 3], [5, 4]];
        let chains = chains(&edges);
        let mut covered: Vec<[u32; 2]> = chains
            .iter()
            .flat_map(|chain| chain.windows(2))
            .map(|ends| [ends[0].min(ends[1]), ends[0].max(ends[1])])
            .collect();
        covered.sort_unstable();
        assert_eq!(covered, [[0, 1], [0, 2], [1, 2], [2, 3], [4, 5]]);
        assert!(chains.len() <= 3, "{chains:?}");
    }
}
