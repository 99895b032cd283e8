from glob import glob
import sys

from setuptools import find_packages, setup

PACKAGE = 'forcecal_ros'
MUJOCO = ["mujoco>=3.11; python_version >= '3.11'"]
PLOTS = ['plotly>=5.15']
NODES = ['gap', 'impedance', 'observer', 'sequencer', 'sim']
# colcon calls one of these, and has executables in lib/forcecal_ros (setup.cfg), where ros2 run
# looks; pip calls neither, and would put names as common as these into everybody's PATH
COLCON = not {'install', '--editable'}.isdisjoint(sys.argv)
SCALE = ['distributed>=2024.1']

setup(
    name=PACKAGE,
    version='0.1.0',
    description='Self-calibrating force sensing for robots: identify, observe, diagnose',
    author='forcecal_ros maintainers',
    maintainer='forcecal_ros maintainers',
    maintainer_email='maintainers@forcecal-ros.example',
    license='Apache-2.0',
    python_requires='>=3.10',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['config/**/*.yaml', 'config/**/*.xml', '**/*.html.j2',
                            'diagnose/**/*.json', 'nodes/*.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', sorted(glob('config/*.yaml'))),
        (f'share/{PACKAGE}/config/examples', sorted(glob('config/examples/*'))),
        (f'share/{PACKAGE}/config/presets', sorted(glob('config/presets/*.yaml'))),
        (f'share/{PACKAGE}/launch', sorted(glob('launch/*.launch.py'))),
        (f'share/{PACKAGE}/layouts', sorted(glob('layouts/*.*'))),
    ],
    install_requires=[
        'argcomplete>=2.0',
        "backports.zstd>=1.0; python_version < '3.14'",  # in the standard library since
        'jinja2>=3.1',
        'lz4>=4.0',
        'matplotlib>=3.6',
        'numba>=0.58',
        'numpy>=1.26',
        'pandas>=2.0',
        'pyyaml>=6.0',
        'rosbags>=0.11',
        'scipy>=1.11',
        'tqdm>=4.66',
    ],
    extras_require={
        # models in MuJoCo: --mujoco; older ones mount sensors so
        'mujoco': MUJOCO,
        # many recordings on many machines: --dask
        'scale': SCALE,
        # benchmark/any_simulator.py and examples/drake_arm.py; the package does not import it
        'drake': ['drake>=1.40'],
        # pictures of reports that zoom; rosdep has no key for it, and pages do without
        'plots': PLOTS,
        # the pages of docs/ as a site: sphinx-build -W -c docs . build/site
        'docs': ['furo>=2024.1', 'myst-parser>=3.0', 'sphinx>=7.2'],
        # for machines without a ROS 2 distribution; colcon and rosdep never ask for it
        'ros': [
            'ros-jazzy-common-interfaces==5.3.6',
            'ros-jazzy-rclpy[fastrtps]==7.1.6',
        ],
        # colcon test runs pytest because of this name and its first entry
        'test': [
            'pytest>=7.4,<9.2',  # 9.2 keeps pytest-xdist 3.8 from seeing the groups
            'pytest-rerunfailures>=13',
            'pytest-timeout>=2.1',
            'pytest-xdist>=3.7',  # orders groups by their place, not their number
            'hypothesis>=6.98',
            *MUJOCO,
            *PLOTS,
            *SCALE,
            'colcon-common-extensions>=0.3.0',
            'mypy>=2.4,<2.5',
            'ruff>=0.17.5,<0.18',
            'setuptools>=70.1',
            'types-PyYAML>=6.0',
        ],
    },
    entry_points={
        'console_scripts': [
            'forcecal = forcecal_ros.entry:forcecal',
            *(f'{node} = forcecal_ros.entry:{node}' for node in NODES if COLCON),
        ],
    },
    zip_safe=False,
)
