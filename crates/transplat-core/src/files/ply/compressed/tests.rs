use super::*;
use crate::files::{load_splat, write_splat};
use crate::synthetic;

#[test]
fn older_files_have_whole_colors() {
    let mut cloud = synthetic::sphere(100);
    for (i, f) in cloud.sh.iter_mut().enumerate() {
        *f = [0.01 * i as f32, -0.5, 0.3 + 0.002 * i as f32];
    }
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("splat.compressed.ply");
    write_splat(&cloud, &cloud.sh, &path).expect("room for it");
    let bytes = std::fs::read(&path).expect("it is there");
    let mut reader = std::io::Cursor::new(&bytes);
    let header = Header::parse(&mut reader).expect("a header");
    let (head, body) = bytes.split_at(header.bytes as usize);
    let head = String::from_utf8_lossy(head);
    let is_color = |line: &&str| line.contains("min_") || line.contains("max_");
    let colors = ["_r\n", "_g\n", "_b\n"];
    let kept = head.split_inclusive('\n');
    let kept: String = kept
        .filter(|line| !(is_color(line) && colors.iter().any(|c| line.ends_with(c))))
        .collect();
    // A chunk of 12 numbers instead of 18.
    let older = [kept.as_bytes(), &body[..48], &body[72..]].concat();
    std::fs::write(&path, older).expect("room for it");
    let (older, file) = load_splat(&path).expect("a good file");
    let share = |value: f32, of: [f32; 2]| (value - of[0]) / (of[1] - of[0]);
    for i in 0..100 {
        let j = file.surfel_of(i).expect("a row");
        let [red, _, blue] = older.sh_of(j)[0].map(color_of_dc);
        // The codes span the range of the chunk, and are the colour here.
        let expected = [
            share(cloud.sh[i][0], [0.0, 0.99]),
            share(cloud.sh[i][2], [0.3, 0.498]),
        ];
        assert!((red - expected[0]).abs() < 3e-3, "{i}: {red} {expected:?}");
        assert!(
            (blue - expected[1]).abs() < 3e-3,
            "{i}: {blue} {expected:?}"
        );
    }
}
