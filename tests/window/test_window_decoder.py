"""A photograph behind a trained pattern, decoded in the window."""

import numpy as np
import tifffile
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QFileDialog
from small_bench.trained import write_trained
from test_window_run import acquire_small, set_bracket

from labapp.window.commands import DECODER
from labapp.window.messages import PictureSaved, ReconstructionResult, RunEnded
from labapp.window.reconstruction_view import DECODER_TITLE
from labapp.window.spectral_messages import RecordBands


def is_offered(view) -> bool:
    return view.method.model().item(view.method.findText(DECODER_TITLE)).isEnabled()


def test_a_photograph_through_a_trained_pattern_is_decoded(
    bench, person, qtbot, monkeypatch, tmp_path
):
    window, view = bench.window, bench.window.reconstruction
    pattern = write_trained(tmp_path / "trained.h5", bench.folder / "bench.toml", seed=1)
    bench.reports.clear()
    set_bracket(person, window.run.star, "8", "8", "2")
    set_bracket(person, window.run.photograph, "400", "2", "1")
    person.chooses(window.pattern.form.kind, "Image file")
    person.types(window.pattern.form.file, str(pattern))
    person.presses(Qt.Key.Key_F6)
    person.waits(lambda: bench.last(RunEnded) is not None)
    person.waits(lambda: bench.last(RecordBands) is not None)
    assert bench.last(RecordBands).decoder == "trained.h5"
    person.waits(lambda: is_offered(view))

    person.waits(window.actions_["reconstruct"].isEnabled)
    window.tabs.setCurrentWidget(view)
    person.chooses(view.method, DECODER_TITLE)
    assert view.choices == (DECODER, None, False)
    assert not view.budget.isEnabled()
    person.clicks(view.start)
    person.waits(lambda: bench.last(ReconstructionResult) is not None)
    result = bench.last(ReconstructionResult)
    person.waits(lambda: "decoder trained.h5, blind" in view.note.text())
    assert "weights" in view.note.text()
    assert "Residual" not in view.note.text()
    assert result.before.shape == result.after.shape == bench.frame.image.shape
    assert not np.array_equal(result.before, result.after)
    assert result.neutral is not None
    person.waits(lambda: person.looks_at(view.picture).std() > 5)

    file = tmp_path / "sharp.tiff"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", staticmethod(lambda *_: (str(file), "")))
    person.clicks(view.save)
    person.waits(lambda: bench.last(PictureSaved) is not None)
    assert tifffile.imread(file).shape == result.after.shape
    person.chooses(view.method, "Automatic")
    assert view.budget.isEnabled()


def test_a_photograph_through_another_pattern_has_no_decoder(bench, person):
    window, view = bench.window, bench.window.reconstruction
    acquire_small(bench, person)
    person.waits(lambda: bench.last(RecordBands) is not None)
    assert bench.last(RecordBands).decoder == ""
    person.waits(lambda: not is_offered(view))
    assert view.method.currentText() != DECODER_TITLE
    assert view.budget.isEnabled()
    person.waits(window.actions_["reconstruct"].isEnabled)
