# Formula of the program, for a tap. Each release has this file with the checksum of its source archive (scripts/recipes.sh); here it
# has none.
class Quadlift < Formula
  desc "3D objects from 2D detections in posed images"
  homepage "https://github.com/quadlift/quadlift"
  url "https://github.com/quadlift/quadlift/archive/refs/tags/v0.1.0.tar.gz"
  sha256 "0000000000000000000000000000000000000000000000000000000000000000"
  license any_of: ["MIT", "Apache-2.0"]

  depends_on "rust" => :build

  def install
    system "cargo", "install", *std_cargo_args(path: "crates/quadlift-cli")
    generate_completions_from_executable(bin/"quadlift", "completions")
    (man1/"quadlift.1").write Utils.safe_popen_read(bin/"quadlift", "man")
  end

  test do
    system bin/"quadlift", "synth", "-o", "scene.json"
    system bin/"quadlift", "localize", "scene.json", "-o", "objects.json"
    assert_path_exists testpath/"objects.json"
  end
end
