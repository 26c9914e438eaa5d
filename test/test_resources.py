import pytest

from portnav_ros import resources
from portnav_ros.params import ParamError


def lay_down(folder, *files):
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    return folder


def test_checkout_is_its_own_share(tmp_path):
    lay_down(tmp_path, 'package.xml', 'portnav_ros/resources.py')
    assert resources.share_directory(tmp_path / 'portnav_ros/resources.py') == tmp_path


@pytest.mark.parametrize(
    'site',
    ['lib/python3.12/site-packages', 'local/lib/python3.12/dist-packages', 'lib/python3/dist-packages', '.'],
)
def test_installation_finds_the_share_of_its_prefix(tmp_path, site):
    share = lay_down(tmp_path, 'share/portnav_ros/package.xml') / 'share/portnav_ros'
    module = lay_down(tmp_path / site, 'portnav_ros/resources.py') / 'portnav_ros/resources.py'
    assert resources.share_directory(module) == share


def test_a_checkout_inside_a_prefix_keeps_its_own_files(tmp_path):
    lay_down(tmp_path, 'share/portnav_ros/package.xml', 'src/package.xml', 'src/portnav_ros/resources.py')
    assert resources.share_directory(tmp_path / 'src/portnav_ros/resources.py') == tmp_path / 'src'


def test_another_overlay_does_not_matter(tmp_path, monkeypatch):
    lay_down(
        tmp_path, 'share/ament_index/resource_index/packages/portnav_ros', 'share/portnav_ros/package.xml'
    )
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    assert tmp_path not in resources.config_path().parents


def test_linked_package_is_followed(tmp_path):
    lay_down(tmp_path, 'src/package.xml', 'src/portnav_ros/resources.py', 'build/setup.py')
    (tmp_path / 'build/portnav_ros').symlink_to(tmp_path / 'src/portnav_ros')
    assert resources.share_directory(tmp_path / 'build/portnav_ros/resources.py') == tmp_path / 'src'


def test_no_share_says_so(tmp_path):
    with pytest.raises(ParamError, match='install the package again'):
        resources.share_directory(tmp_path / 'portnav_ros/resources.py')


def test_config_is_there():
    assert resources.config_path('difficulties').is_dir()


def test_missing_file_names_itself_and_its_neighbours():
    with pytest.raises(
        ParamError, match=r'difficulties/papr\.yaml: no such file; difficulties/ holds .*paper\.yaml'
    ):
        resources.config_path('difficulties', 'papr.yaml')


def test_missing_model_names_itself():
    with pytest.raises(ParamError, match=r'models/none\.safetensors: no such file'):
        resources.model_path('none.safetensors')
