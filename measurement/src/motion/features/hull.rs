//! Convex hulls: area and volume of the space that a path takes up.

use std::collections::HashSet;

use nalgebra::{Point2, Point3, Vector3};

/// Area of the convex hull of points in a plane (Andrew's monotone chain).
pub fn area(points: &[Point2<f64>]) -> f64 {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let lower = half_hull(sorted.iter().copied());
    let upper = half_hull(sorted.iter().rev().copied());
    let ring: Vec<_> = lower.into_iter().chain(upper).collect();
    let next = ring.iter().cycle().skip(1);
    ring.iter().zip(next).map(|(a, b)| a.x * b.y - a.y * b.x).sum::<f64>() / 2.0
}

fn half_hull(points: impl Iterator<Item = Point2<f64>>) -> Vec<Point2<f64>> {
    let mut chain: Vec<Point2<f64>> = Vec::new();
    for point in points {
        while let [.., a, b] = chain[..] {
            if (b - a).perp(&(point - b)) > 0.0 {
                break;
            }
            chain.pop();
        }
        chain.push(point);
    }
    chain
}

/// A point on a lattice of 2²⁰ steps across the path.
type LatticePoint = Vector3<i64>;

/// Lattice steps across the points' largest extent. With coordinates below 2²⁰ every determinant stays below 6·2⁶⁰ and
/// is exact in 64 bits. Exactness matters: on a path sampled each millimetre most points are nearly coplanar, and with
/// rounded signs the hull would split into ever more faces.
const LATTICE_STEPS: f64 = 1_048_576.0;

/// Volume of the convex hull of points in space; almost 0 if they lie in a plane. Points are added one by one to a
/// tetrahedron: each new point replaces the faces that it sees by a cone to their horizon.
pub fn volume(points: &[Point3<f64>]) -> f64 {
    let Some((points, unit)) = on_lattice(points) else { return 0.0 };
    let Some([a, b, c, d]) = tetrahedron(&points) else { return 0.0 };
    let height =
        |[i, j, k]: [usize; 3], from: usize| six_times_volume(&points[i], &points[j], &points[k], &points[from]);
    let corners = [([a, b, c], d), ([a, b, d], c), ([a, c, d], b), ([b, c, d], a)];
    let outward = |(face, inner)| if height(face, inner) > 0 { [face[1], face[0], face[2]] } else { face };
    let mut faces: Vec<[usize; 3]> = corners.map(outward).to_vec();
    for point in extreme_points(&points) {
        add_point(&mut faces, point, &points);
    }
    // Nearly all other points lie inside by now, and a point inside a hull stays inside as the hull grows.
    let planes: Vec<FacePlane> = faces.iter().map(|face| FacePlane::of(face, &points)).collect();
    for point in (0..points.len()).filter(|&point| planes.iter().any(|plane| plane.sees(&points[point]))) {
        add_point(&mut faces, point, &points);
    }
    // The signed cones from the origin to all faces, summed exactly, then scaled back to millimetres.
    let six: i128 = faces.iter().map(|[i, j, k]| i128::from(points[*i].cross(&points[*j]).dot(&points[*k]))).sum();
    six as f64 / 6.0 * unit.powi(3)
}

/// Adds a point to a hull: a cone to the horizon replaces the faces that the point sees.
fn add_point(faces: &mut Vec<[usize; 3]>, point: usize, points: &[LatticePoint]) {
    let sees = |[i, j, k]: &[usize; 3]| six_times_volume(&points[*i], &points[*j], &points[*k], &points[point]) > 0;
    if faces.iter().any(sees) {
        let (seen, hidden): (Vec<[usize; 3]>, _) = faces.iter().partition(|face| sees(face));
        *faces = hidden;
        faces.extend(horizon(&seen).into_iter().map(|(i, j)| [i, j, point]));
    }
}

/// The points that lie farthest in evenly spread directions. Their hull contains most of the other points.
fn extreme_points(points: &[LatticePoint]) -> impl Iterator<Item = usize> {
    let directions =
        (0..27).map(|k| Vector3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1)).filter(|d| *d != Vector3::zeros());
    directions.filter_map(move |direction| (0..points.len()).max_by_key(|&point| direction.dot(&points[point])))
}

/// The plane of a face.
struct FacePlane {
    normal: LatticePoint,
    height: i64,
}

impl FacePlane {
    fn of([i, j, k]: &[usize; 3], points: &[LatticePoint]) -> Self {
        let normal = (points[*j] - points[*i]).cross(&(points[*k] - points[*i]));
        Self { height: normal.dot(&points[*i]), normal }
    }

    /// True if the point lies outside the face.
    fn sees(&self, point: &LatticePoint) -> bool {
        self.normal.dot(point) > self.height
    }
}

/// The edges around a set of adjacent faces, each in the direction that it has in its face.
fn horizon(faces: &[[usize; 3]]) -> Vec<(usize, usize)> {
    let edges: HashSet<_> = faces.iter().flat_map(|&[i, j, k]| [(i, j), (j, k), (k, i)]).collect();
    edges.iter().filter(|(i, j)| !edges.contains(&(*j, *i))).copied().collect()
}

/// The points in lattice steps from their lower corner, and the length of a step; `None` if all points coincide.
fn on_lattice(points: &[Point3<f64>]) -> Option<(Vec<LatticePoint>, f64)> {
    let first = points.first()?.coords;
    let (least, most) = points.iter().fold((first, first), |(l, m), p| (l.inf(&p.coords), m.sup(&p.coords)));
    let unit = (most - least).max() / (LATTICE_STEPS - 1.0);
    let step = |p: &Point3<f64>| ((p.coords - least) / unit).map(|c| c.round() as i64);
    (unit > 0.0).then(|| (points.iter().map(step).collect(), unit))
}

/// Six times the volume of a tetrahedron; positive if `a`, `b`, `c` run counter-clockwise as seen from `from`.
fn six_times_volume(a: &LatticePoint, b: &LatticePoint, c: &LatticePoint, from: &LatticePoint) -> i64 {
    (b - a).cross(&(c - a)).dot(&(from - a))
}

/// Four points that span a large volume; `None` if all points lie in a plane.
fn tetrahedron(points: &[LatticePoint]) -> Option<[usize; 4]> {
    let farthest = |measure: &dyn Fn(&LatticePoint) -> i128| (0..points.len()).max_by_key(|&i| measure(&points[i]));
    let square = |v: LatticePoint| v.iter().map(|c| i128::from(*c).pow(2)).sum();
    let a = farthest(&|p| square(p - points[0]))?;
    let b = farthest(&|p| square(p - points[a]))?;
    let c = farthest(&|p| square((points[b] - points[a]).cross(&(p - points[a]))))?;
    let d = farthest(&|p| i128::from(six_times_volume(&points[a], &points[b], &points[c], p)).abs())?;
    (six_times_volume(&points[a], &points[b], &points[c], &points[d]) != 0).then_some([a, b, c, d])
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_square_with_points_inside_and_on_its_edges_has_its_area() {
        let points = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0], [1.0, 1.0], [1.0, 0.0], [2.0, 0.0]];
        assert_eq!(area(&points.map(Point2::from)), 4.0);
        assert_eq!(area(&[]), 0.0);
        assert_eq!(area(&[Point2::new(1.0, 5.0); 3]), 0.0);
    }

    #[test]
    fn points_in_a_plane_have_next_to_no_volume() {
        let points: Vec<_> =
            (0..50).map(|i| Point3::new(f64::from(i), f64::from(i * i % 7), f64::from(2 * i))).collect();
        assert!(volume(&points) < 1e-6 * 98.0_f64.powi(3)); // the lattice's steps, and no more
        assert_eq!(volume(&points.iter().map(|p| Point3::new(p.x, p.y, 1.0)).collect::<Vec<_>>()), 0.0);
        assert_eq!(volume(&[]), 0.0);
    }

    #[test]
    fn many_points_on_a_sphere_have_nearly_its_volume() {
        let on_sphere = |i: u32| {
            let (z, turn) = (1.0 - (2.0 * f64::from(i) + 1.0) / 4000.0, 2.399_963 * f64::from(i));
            let r = (1.0 - z * z).sqrt();
            Point3::new(r * turn.cos(), r * turn.sin(), z)
        };
        let points: Vec<_> = (0..4000).map(on_sphere).collect();
        let exact = 4.0 / 3.0 * std::f64::consts::PI;
        assert!((volume(&points) / exact - 1.0).abs() < 2e-3);
    }

    #[test]
    fn a_smooth_curve_has_a_hull_although_its_points_are_nearly_coplanar() {
        let curve = |t: f64| {
            Point3::new(25.0 * t.sin() + 6.0 * (7.0 * t).sin(), 25.0 * (2.0 * t).cos(), 25.0 * (3.0 * t).sin())
        };
        let points: Vec<_> = (0..1000).map(|i| curve(f64::from(i) / 159.0)).collect();
        let twice: Vec<_> = points.iter().chain(&points).rev().copied().collect();
        assert!(volume(&points) > 1e4);
        assert!((volume(&twice) / volume(&points) - 1.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn a_turned_box_full_of_points_has_its_volume(
            size in prop::array::uniform3(10.0f64..200.0),
            angles in prop::array::uniform3(-3.0f64..3.0),
            inside in prop::collection::vec(prop::array::uniform3(0.0f64..1.0), 0..60),
        ) {
            let corners = (0..8).map(|i| [f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)]);
            let turn = Rotation3::from_euler_angles(angles[0], angles[1], angles[2]);
            let place = |p: [f64; 3]| turn * Point3::new(p[0] * size[0], p[1] * size[1], p[2] * size[2]);
            let points: Vec<_> = inside.into_iter().chain(corners).map(place).collect();
            let exact = size[0] * size[1] * size[2];
            prop_assert!((volume(&points) / exact - 1.0).abs() < 2e-5, "{} for {exact}", volume(&points));
        }
    }
}
