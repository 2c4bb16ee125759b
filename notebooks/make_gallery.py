"""Makes README.md, which shows a picture of each notebook, and these pictures.

    python notebooks/make_gallery.py [NAME ...]

runs the notebooks, all or those that are named, in kernels of their own, takes one
picture out of each and writes it into `gallery`, with a hash of the code that made it.
Then README.md is written anew.
"""

import base64
import hashlib
import io
import shutil
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image, PngImagePlugin

FOLDER = Path(__file__).resolve().parent
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))

# Which of a notebook's pictures stands for it: the last one is -1.
PICTURES = {
    "00_five_minutes": 1,
    "01_building_the_diagram": 1,
    "02_delay_one_dof": 1,
    "03_delay_two_dof": 3,
    "04_networks": 2,
    "05_neural_network": 2,
    "06_architectures": 3,
    "07_stability": 4,
    "08_drive": 1,
    "09_arm_in_space": 2,
    "10_classic_results": 0,
    "11_machine_code": 1,
}

WIDTH = 900  # pixels

# The notebooks in a Jupyter that was started as HEAD says.
JUPYTER = "http://localhost:8888/lab/tree"

HEAD = """\
# Notebooks

What each of them is about, and one of its pictures. They are committed without outputs;
`pip install '.[notebooks]' && jupyter lab notebooks` opens them to run. While this
Jupyter runs, each link *open in your Jupyter* opens the notebook there.
[solutions.md](solutions.md) has answers to the things to try, for teachers.
`python notebooks/make_gallery.py` makes this page.
"""


def CodeHash(notebook) -> str:
    """Returns a hash of the code cells of a notebook."""
    code = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    return hashlib.sha256("\0".join(code).encode()).hexdigest()


def PictureOf(notebook, stem: str) -> Image.Image:
    """Returns the picture that stands for a notebook that has run."""
    found = [
        output.data["image/png"]
        for cell in notebook.cells
        if cell.cell_type == "code"
        for output in cell.outputs
        if "image/png" in output.get("data", {})
    ]
    picture = Image.open(io.BytesIO(base64.b64decode(found[PICTURES[stem]])))
    height = round(picture.height * WIDTH / picture.width)
    return picture.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)


def PathOf(stem: str) -> Path:
    """Returns where the picture of a notebook is."""
    return FOLDER / "gallery" / f"{stem}.png"


def MakePicture(path: Path) -> None:
    """Runs a notebook and writes its picture."""
    notebook = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as temporary:
        for file in FOLDER.glob("*.py"):
            Path(temporary, file.name).write_bytes(file.read_bytes())
        for name in ("classics", "league"):
            shutil.copytree(FOLDER / name, Path(temporary, name))
        resources = {"metadata": {"path": temporary}}
        NotebookClient(notebook, timeout=600, resources=resources).execute()
    text = PngImagePlugin.PngInfo()
    text.add_text("Code", CodeHash(notebook))
    # A palette makes a drawing of lines a quarter of the size.
    picture = PictureOf(notebook, path.stem).quantize(256)
    PathOf(path.stem).parent.mkdir(exist_ok=True)
    picture.save(PathOf(path.stem), optimize=True, pnginfo=text)


def MakePage() -> str:
    """Returns the text of README.md."""
    parts = [HEAD]
    for path in NOTEBOOKS:
        first = nbformat.read(path, as_version=4).cells[0].source
        title, about, *_ = first.removeprefix("# ").split("\n\n")
        picture = PathOf(path.stem).relative_to(FOLDER).as_posix()
        own = f"[open in your Jupyter]({JUPYTER}/{path.name})"
        text = f"{about}\n\n![{title}]({picture})\n"
        parts.append(f"## [{title}]({path.name})\n\n{own}\n\n{text}")
    return "\n".join(parts)


def main(names: list[str]) -> None:
    """Makes the pictures of some notebooks, and the page."""
    for path in NOTEBOOKS:
        if not names or path.stem in names:
            MakePicture(path)
            print(f"Written: {PathOf(path.stem)}")
    (FOLDER / "README.md").write_text(MakePage(), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
