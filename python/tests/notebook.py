"""Runs the cells of a notebook, and returns what they print and plot as Jupyter keeps it.

    UPDATE=1 python -m pytest python/tests/with_torch.py -k notebook

runs the notebook in full, and writes its outputs.
"""

import base64
import contextlib
import io
import json

import matplotlib

matplotlib.use("agg")

DPI = 50


def executed(path, change=lambda source: source):
    """Run all cells. Return the notebook with their outputs, and the names that they defined. ``change``: changes a source."""
    import matplotlib.pyplot as plt

    notebook, names, count = json.loads(path.read_text()), {}, 0
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            continue
        count += 1
        shown, said = set(plt.get_fignums()), io.StringIO()
        with contextlib.redirect_stdout(said):
            exec(change("".join(cell["source"])), names)
        outputs = []
        if said.getvalue():
            lines = said.getvalue().splitlines(keepends=True)
            outputs.append({"name": "stdout", "output_type": "stream", "text": lines})
        for number in sorted(set(plt.get_fignums()) - shown):
            picture = io.BytesIO()
            plt.figure(number).savefig(picture, dpi=DPI, metadata={"Software": None})
            data = {"image/png": base64.b64encode(picture.getvalue()).decode(), "text/plain": ["<Figure>"]}
            outputs.append({"data": data, "metadata": {}, "output_type": "display_data"})
        cell["execution_count"], cell["outputs"] = count, outputs
    return notebook, names


def written(notebook):
    """Return the text of a notebook."""
    return json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"


def printed(notebook):
    """Return what each code cell prints."""
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    texts = [[part["text"] for part in cell["outputs"] if part["output_type"] == "stream"] for cell in cells]
    return ["".join(line for text in of_cell for line in text) for of_cell in texts]


def kinds(notebook):
    """Return the count and the kinds of the outputs of each code cell."""
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    return [(cell["execution_count"], [part["output_type"] for part in cell["outputs"]]) for cell in cells]
