//! `cosplat objects pick --web`: strokes by mouse in a page, which shows what belongs to them.

use std::{net::SocketAddr, path::PathBuf};

use cosplat_renderer::camera::Camera;
use cosplat_semantics::{show, strokes::under};
use cosplat_web::strokes::{Asked, Line, Server, Shown, Told};
use glam::{Mat3, Vec3};

use crate::{
    pick::{Marked, parted},
    prepared::{Found, Output, Prepared},
};
use cosplat_console::{output::announce, say, signals};

use crate::lift::states;

/// Serves the page until Ctrl-C.
///
/// # Errors
/// When the address cannot be had.
pub(crate) fn serve(address: SocketAddr, prepared: Prepared, output: Output) -> anyhow::Result<()> {
    let stop = signals::stop_flag()?;
    let splat = &prepared.splat;
    let name = prepared.path.file_name().unwrap_or_default();
    let (sh_degree, sh) = &prepared.sh;
    let shown = Shown {
        name: name.to_string_lossy().into_owned(),
        up: prepared.up().to_array(),
        bounds: splat.bounds().map(|corner| corner.to_array()),
        gaussians: states(splat),
        sh_degree: *sh_degree,
        sh: sh.clone(),
    };
    let picker =
        move |asked| answer(&prepared, &output, asked).map_err(|error| format!("{error:#}"));
    let server = Server::bind(address, shown, Box::new(picker))?;
    let door = server.door();
    announce(
        &door.link(),
        door.is_local(),
        address,
        "write the file of objects",
    )?;
    server.run(&stop);
    Ok(())
}

fn answer(prepared: &Prepared, output: &Output, asked: Asked) -> anyhow::Result<Told> {
    let strokes = asked.strokes.into_iter();
    let mut marked: Vec<Marked> = strokes.map(|s| (s.name, s.gaussians)).collect();
    let mut line = Vec::new();
    if let Some(drawn) = asked.line {
        line = under(&prepared.splat, &camera(&drawn), &drawn.points);
        anyhow::ensure!(!line.is_empty(), "nothing is seen under the stroke");
        marked.push((drawn.name, line.clone()));
    }
    let found = parted(prepared, &marked);
    let sizes = found.sizes();
    let names = found.names.iter().zip(sizes).enumerate();
    let objects = names.map(|(n, (name, size))| (name.clone(), show::color(n as i32).into(), size));
    let mut told = Told {
        objects: objects.collect(),
        label: found.labels.object.clone(),
        line,
        saved: None,
    };
    if asked.save {
        told.saved = Some(save(prepared, output, found, &marked)?);
    }
    Ok(told)
}

/// Writes the file, and says how to have it again.
fn save(
    prepared: &Prepared,
    output: &Output,
    found: Found,
    marked: &[Marked],
) -> anyhow::Result<PathBuf> {
    let (out, objects, _) = prepared.write(output, found)?;
    let count = objects.names.len();
    say!("{count} objects in {}, as by", out.display())?;
    let mut words = vec![
        "cosplat objects pick".to_owned(),
        quoted(&prepared.path.display()),
    ];
    for (name, gaussians) in marked {
        let point = |n: &u32| {
            let [x, y, z] = prepared.splat.position[*n as usize].to_array();
            format!("{x},{y},{z}")
        };
        let points: Vec<String> = gaussians.iter().map(point).collect();
        let stroke = format!("{name}:{}", points.join(" "));
        words.extend(["--stroke".to_owned(), quoted(&stroke)]);
    }
    if let Some(path) = &output.out {
        words.extend(["--out".to_owned(), quoted(&path.display())]);
    }
    say!("{}", words.join(" "))?;
    Ok(out)
}

/// A word of a shell's command line.
fn quoted(word: &impl ToString) -> String {
    format!("'{}'", word.to_string().replace('\'', "'\\''"))
}

/// The camera of a page's picture.
fn camera(line: &Line) -> Camera {
    let [right, down, forward] = line.axes.map(Vec3::from_array);
    let [width, height] = line.size;
    Camera {
        position: Vec3::from_array(line.position),
        world_from_camera: Mat3::from_cols(right, down, forward),
        focal: [line.focal; 2],
        center: [0.5 * width as f32, 0.5 * height as f32],
        width,
        height,
        near: line.near,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_a_command_stand_in_quotes() {
        assert_eq!(quoted(&"a b"), "'a b'");
        assert_eq!(quoted(&"it's"), r"'it'\''s'");
    }
}
