//! Cases with a known answer at a size for every day: `cosplat bench validate --quick`.

use std::process::Command;

use serde_json::Value;

/// Runs a case; each of its rows must pass, or fail as `docs/validation.md` says.
fn holds(case: &str) {
    let run = Command::new(env!("CARGO_BIN_EXE_cosplat-bench"))
        .args(["validate", "--quick", "--json", "--case", case])
        .output()
        .expect("cosplat starts");
    let text = String::from_utf8_lossy(&run.stdout);
    let errors = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{errors}\n{text}");
    let rows: Vec<Value> = text
        .lines()
        .map(|line| serde_json::from_str(line).expect("every line is JSON"))
        .collect();
    assert!(!rows.is_empty(), "{case} measures nothing");
    for row in &rows {
        assert_eq!(row["case"], case, "{row}");
        assert!(row["measured"].is_number(), "{row}");
        assert_eq!(row["pass"], row["known_failure"].is_null(), "{row}");
    }
}

#[test]
fn soft_matter_keeps_its_energy_beside_a_stiff_object() {
    holds("soft_and_stiff");
}

/// And not above.
#[test]
fn few_particles_are_stable_up_to_the_closed_form_limit() {
    holds("cluster");
}

#[test]
fn a_beam_that_is_clamped_at_either_end_keeps_its_energy() {
    holds("held");
}

#[test]
fn light_matter_bends_under_heavy_matter() {
    holds("uneven");
}

#[test]
fn a_thrown_cube_flies_a_parabola() {
    holds("free_fall");
}

#[test]
fn a_disk_and_a_ball_roll_and_slip_as_friction_says() {
    holds("rolling");
}

#[test]
fn a_rigid_ball_bounces_to_the_height_its_restitution_says() {
    holds("bouncing_ball");
}

#[test]
fn blocks_that_part_are_not_held() {
    holds("stickiness");
}

#[test]
fn a_dam_breaks_as_in_the_experiment() {
    holds("dam_break");
}

#[test]
fn granular_columns_run_out_as_far_as_measured() {
    holds("granular");
}

#[test]
fn what_lies_stays_and_falls_asleep() {
    holds("rest");
}

#[test]
fn a_copper_bar_is_upset_as_codes_agree() {
    holds("taylor_bar");
}

#[test]
fn a_change_of_fidelity_keeps_momentum_and_path() {
    holds("fidelity");
}

#[test]
fn a_client_receives_the_covariance_of_the_deformed_gaussian() {
    holds("covariance");
}

#[test]
fn threads_and_repetition_change_no_bit() {
    holds("determinism");
}

#[test]
fn a_spinning_cube_keeps_its_angular_momentum() {
    holds("spinning_cube");
}

#[test]
fn a_bar_vibrates_at_its_own_frequency() {
    holds("bar");
}

#[test]
fn elastic_disks_meet_in_time_and_part() {
    holds("disks");
}

#[test]
fn a_chosen_motion_of_a_cube_converges() {
    holds("manufactured_cube");
}

#[test]
fn a_chosen_vortex_converges_and_does_not_blow_up() {
    holds("vortex");
}

#[test]
fn a_cantilever_swings_as_far_and_as_fast_as_beams_do() {
    holds("cantilever");
}

#[test]
fn pressure_grows_with_depth() {
    holds("column");
}

#[test]
fn a_block_slides_as_coulomb_says() {
    holds("incline");
}

#[test]
fn viscosity_stops_vortices_at_their_rate() {
    holds("taylor_green");
}

#[test]
fn an_elastic_ball_meets_a_plane_as_hertz_says() {
    holds("hertz");
}

#[test]
fn a_block_floats_as_deep_as_archimedes_says() {
    holds("floating");
}

#[test]
fn an_unknown_case_is_named_with_those_there_are() {
    let run = Command::new(env!("CARGO_BIN_EXE_cosplat-bench"))
        .args(["validate", "--case", "perpetuum"])
        .output()
        .expect("cosplat starts");
    let errors = String::from_utf8_lossy(&run.stderr);
    assert!(!run.status.success());
    assert!(
        errors.contains("'perpetuum'") && errors.contains("free_fall"),
        "{errors}"
    );
}

#[test]
fn balls_that_meet_obliquely_turn_as_the_page_says() {
    holds("oblique");
}
