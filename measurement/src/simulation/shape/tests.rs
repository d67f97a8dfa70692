use std::f64::consts::FRAC_PI_2;

use proptest::prelude::*;

use super::*;

fn somewhere() -> impl Strategy<Value = Point3<f64>> {
    (-80.0..80.0, -50.0..50.0, 90.0..240.0).prop_map(|(x, y, z)| Point3::new(x, y, z))
}

fn direction() -> impl Strategy<Value = Vector3<f64>> {
    (0.0..std::f64::consts::TAU, -FRAC_PI_2..FRAC_PI_2)
        .prop_map(|(turn, lift)| Vector3::new(turn.cos() * lift.cos(), turn.sin() * lift.cos(), lift.sin()))
}

fn rod() -> impl Strategy<Value = RoundCone> {
    (somewhere(), direction(), 0.0..60.0, 1.0..6.0, 0.2..1.0).prop_map(|(a, along, length, radius_a, share)| {
        RoundCone { a, radius_a, b: a + along * length, radius_b: radius_a * share }
    })
}

/// Distance from a point to the solid's surface, negative inside. The solid is the hull of two balls; the search finds
/// the ball between them that is nearest to the point.
fn height_over(solid: &RoundCone, point: Point3<f64>) -> f64 {
    const STEPS: usize = 4000;
    let ball = |i: usize| {
        let share = i as f64 / STEPS as f64;
        let centre = solid.a + (solid.b - solid.a) * share;
        (point - centre).norm() - (solid.radius_a + (solid.radius_b - solid.radius_a) * share)
    };
    (0..=STEPS).map(ball).fold(f64::INFINITY, f64::min)
}

/// The ray through a point near a solid.
fn ray_near(solid: &RoundCone, offset: Vector3<f64>) -> Vector3<f64> {
    let target = nalgebra::center(&solid.a, &solid.b) + offset;
    target.coords / target.z
}

proptest! {
    #[test]
    fn a_meeting_lies_on_the_surface_and_nothing_of_the_solid_lies_before_it(
        solid in rod(), offset in (-9.0..9.0, -9.0..9.0, -9.0..9.0)
    ) {
        let v = ray_near(&solid, Vector3::new(offset.0, offset.1, offset.2));
        let Some(met) = solid.meet(v) else { return Ok(()) };
        let point = Point3::from(v * met.depth);
        prop_assert!(height_over(&solid, point).abs() < 2e-3, "{} mm off", height_over(&solid, point));
        prop_assert!((met.normal.norm() - 1.0).abs() < 1e-9 && met.normal.dot(&v) < 1e-9);
        for step in 1..40 {
            let before = Point3::from(v * (met.depth - 0.5 * f64::from(step)));
            prop_assert!(height_over(&solid, before) > -1e-3, "inside {} mm before the meeting", 0.5 * f64::from(step));
        }
    }

    #[test]
    fn a_ray_that_misses_passes_outside(solid in rod(), offset in (-9.0..9.0, -9.0..9.0, -9.0..9.0)) {
        let v = ray_near(&solid, Vector3::new(offset.0, offset.1, offset.2));
        if solid.meet(v).is_none() {
            let nearest = (0..600).map(|i| height_over(&solid, Point3::from(v * f64::from(i) * 0.5)));
            prop_assert!(nearest.fold(f64::INFINITY, f64::min) > -0.05);
        }
    }

    #[test]
    fn near_never_overlooks_a_ray_that_meets(
        solid in rod(), offset in (-9.0..9.0, -9.0..9.0, -9.0..9.0), aside in direction(),
    ) {
        let v = ray_near(&solid, Vector3::new(offset.0, offset.1, offset.2));
        if solid.meet(v).is_some() {
            let unit = v.normalize();
            let across = aside.cross(&unit) * 0.02;
            let beside = (unit + across).normalize();
            prop_assert!(solid.may_meet(beside, beside.cross(&unit).norm() + 1e-9));
        }
    }

    #[test]
    fn a_tubes_silhouette_is_where_the_tangent_planes_say(
        tip in somewhere(), axis in direction(), behind in 2.0..24.0,
    ) {
        let tube = TapedTube::new(tip, axis, (4.0, 3.94), 26.0, 200.0);
        let on_axis: Point3<f64> = tip - axis * behind;
        // Seen along its own axis a tube shows its face and has no borders.
        let turned_away = axis.cross(&on_axis.coords.normalize()).norm();
        prop_assume!(on_axis.z > 60.0 && turned_away > 0.1);
        for (side, border) in tube.borders().into_iter().enumerate() {
            // The point of the surface that the plane touches, and rays a hair inside and outside of it.
            let touch = on_axis - border * tube.radius;
            let towards = |miss: f64| { let p = touch + border * miss; p.coords / p.z };
            let inside = tube.meet(towards(0.002)).map(|(_, part, _)| part);
            prop_assert_eq!(inside, Some(TubePart::Band), "side {}", side);
            let outside = tube.meet(towards(-0.002)).map(|(_, part, _)| part);
            prop_assert!(outside != Some(TubePart::Band), "side {}", side);
        }
    }
}

#[test]
fn a_tube_that_points_at_the_camera_shows_its_face() {
    let axis = Vector3::new(0.0, 0.6, -0.8);
    let tube = TapedTube::new(Point3::new(0.0, 0.0, 100.0), axis, (4.0, 3.94), 26.0, 150.0);
    let (met, part, behind) = tube.meet(Vector3::new(0.0, 0.0, 1.0)).unwrap();
    assert_eq!((part, behind), (TubePart::Face, 0.0));
    assert!((met.depth - 100.0).abs() < 1e-9);
}
