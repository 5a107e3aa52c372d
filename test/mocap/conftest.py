import pytest


@pytest.fixture
def export(tmp_path):
    """Writes a file as a motion capture system would; lists are rows of cells."""

    def write(name, content, delimiter=',', newline='\n', encoding='utf-8'):
        if not isinstance(content, str):
            content = '\n'.join(delimiter.join(map(str, row)) for row in content) + '\n'
        path = tmp_path / name
        path.write_bytes(content.replace('\n', newline).encode(encoding))
        return path

    return write
