"""Lines of progress: at least one every ten seconds, whatever is told."""

from eskin.verbs import milestones


def test_a_beat_where_nothing_moves_and_none_where_something_was_said():
    now, lines = [0.0], []
    told = milestones.Milestones(lines.append, lambda: now[0])
    now[0] = 9.0
    told.beat("training")
    assert not lines
    now[0] = 11.0
    told.beat("training")
    told.beat("training")
    assert lines == ["training, 11 s so far"]
    now[0] = 12.0
    told("frames", 0, 128000)
    now[0] = 22.0
    told.beat("training")
    assert lines[1:] == ["frames: 0 of 128000, 22 s so far"]


def test_it_beats_by_itself_while_a_block_runs(monkeypatch):
    monkeypatch.setattr(milestones, "MILESTONE_S", 0.02)
    lines = []
    with milestones.Milestones(lines.append).alive("synthesis"):
        for _ in range(200):
            if lines:
                break
            milestones.time.sleep(0.02)
    assert lines and lines[0].startswith("synthesis, ")
