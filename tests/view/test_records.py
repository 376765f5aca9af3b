"""Records that a command wrote, read again by the page."""

import pytest

from harness.common.errors import UserError
from harness.view.frame import read_record


@pytest.mark.parametrize("text", ["{", "[]", "[" * 100_000])
def test_what_is_no_record_is_refused(tmp_path, text):
    (tmp_path / "check.json").write_text(text, encoding="utf-8")
    with pytest.raises(UserError, match=r"check\.json"):
        read_record(tmp_path / "check.json")
